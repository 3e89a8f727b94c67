"""A walk at each stage of its estimation, and the longest walk of a recording."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
from mecazen.keys import ODOM, SKELETONS, TARGET_SKELETON
from mecazen.messages import Message
from mecazen.portable import Floats
from mecazen.robots import split_key
from mecazen.skeleton import JOINTS
from mecazen_recorder.reader import Recording
from mecazen_recorder.writer import RecordingError
from mecazen_tools.table import Poses

from mecazen_experiments.gait.motion import (
    LEGS,
    PATH_HZ,
    SEEN,
    Motion,
    about_path,
    lowpass,
    motions,
)
from mecazen_experiments.gait.refine import (
    cycle,
    refine,
    regular,
    rhythm,
    smooth,
    unswapped,
)
from mecazen_experiments.gait.strides import Events, Gait, planted, strides, summary, zeni

WALKS_M_S = 0.25
"""Speed along the path above which a person walks."""
BEGIN_S, END_S = 1.5, 0.5
"""Times left out at the beginning and end of a walk, while the speed changes [s]."""
VIEWS = ("front", "front left", "left", "back left", "back", "back right", "right", "front right")


class Stage(NamedTuple):
    """A walk in one of the stages `truth`, `raw`, `filtered` and `refined`."""

    t: Floats
    """Times (n,) [s], at a constant rate."""
    joints: Floats
    """Joints (n, 20, 3) [m] in a level frame; raw joints are NaN in frames without a reported
    body."""
    events: Events | None = None
    """Events; None if none can be found."""
    strides: pd.DataFrame | None = None
    """The rows of `strides`; None without any."""

    @property
    def gait(self) -> Gait | None:
        """The parameters; None without a stride of each side."""
        return summary(self.strides)


def true_stage(truth: Motion) -> Stage:
    """Return the truth, with the events of the planted feet."""
    events = planted(truth.t, truth.joints)
    return Stage(truth.t, truth.joints, events, strides(truth.t, truth.joints, events))


def seen_stages(seen: Motion) -> dict[str, Stage]:
    """Return the stages of a walk from a tracker's reports; a stage is missing if nothing remains.

    `raw` has the reported joints, with the events of `filtered`. `filtered` has no swaps and gaps,
    and is low-passed. `refined` is the result of `refine`. Events are corrected for their mean
    errors, and those of `filtered` follow the rhythm of the strides.
    """
    t, corrected = seen.t, unswapped(seen)
    stages = {"raw": Stage(t, seen.joints)}
    if (filtered := smooth(corrected)) is None:
        return stages
    if (walk := about_path(filtered, seen.rate_hz)) is None:
        return stages | {"filtered": Stage(t, filtered)}
    legs_seen = np.stack([(seen.confidence[:, leg] == SEEN).all(axis=1) for leg in LEGS], axis=-1)
    mean = cycle(corrected, walk)
    even, actual = rhythm(corrected, walk, mean)
    events = zeni(t, walk).each(partial(regular, even=even, actual=actual))
    stages["raw"] = Stage(t, seen.joints, events)
    stages["filtered"] = Stage(t, filtered, events, strides(t, filtered, events, legs_seen))
    refined = refine(corrected, walk, mean)
    stages["refined"] = Stage(t, refined)
    if (walk := about_path(refined, seen.rate_hz)) is not None:
        events = zeni(t, walk)
        stages["refined"] = Stage(t, refined, events, strides(t, refined, events, legs_seen))
    return stages


def read_walk(
    recording: Recording, run: int | None = None, robot: str = ""
) -> tuple[dict[str, Stage], dict[str, Any]]:
    """Return the longest walk of a run, by default of the last one.

    Returns:
        The stages `raw`, `filtered`, `refined` and, if it was recorded, `truth`; and information on
        the walk: `view`, the side of the person that the robot sees; `run` and `seed`;
        `bearing_deg`, the direction to the robot, relative to straight ahead of the person and
        positive to the left; `distance_m`, the mean distance from the pelvis to the robot; and
        `seen_percent`, the share of the frames in which each joint is in view and not hidden.

    Raises:
        RecordingError: There is no such run, or the data of the body tracker was not recorded.
    """
    run, seed, messages = _messages(recording, run, robot)
    truth, seen = motions(messages[TARGET_SKELETON.key], messages[SKELETONS.key])  # type: ignore[arg-type]
    odom = [(m.header.stamp.ns / 1e9, *m.pose.pose.to_planar()) for m in messages[ODOM.key]]  # type: ignore[attr-defined]
    times, *columns = np.array(odom).T
    seen = seen.evenly()
    at = np.minimum(np.searchsorted(times, seen.t - 1e-6), len(times) - 1)
    robots = Poses(*(column[at] for column in columns))
    seen = seen.placed(robots)
    rows = _walked(seen)
    if rows is None:
        raise RecordingError(f"{recording.path}: nobody walks for 3 s in run {run}")
    seen, robots = seen.where(rows), Poses(*(column[rows] for column in robots))
    stages = seen_stages(seen)
    if len(truth.t):
        inside = (truth.t >= seen.t[0]) & (truth.t <= seen.t[-1])
        stages = {"truth": true_stage(truth.where(inside)), **stages}
    pelvis = seen.joints[seen.reported, 0, :2]
    ahead_x, ahead_y = pelvis[-1] - pelvis[0]
    to_robot = np.stack((robots.x, robots.y), axis=-1)[seen.reported] - pelvis
    x, y = to_robot.mean(axis=0)
    bearing_deg = math.degrees(math.atan2(ahead_x * y - ahead_y * x, ahead_x * x + ahead_y * y))
    shares = (1e2 * (seen.confidence == SEEN).mean(axis=0)).tolist()
    return stages, {
        "view": VIEWS[round(bearing_deg / 45.0) % len(VIEWS)],
        "run": run,
        "seed": seed,
        "bearing_deg": bearing_deg,
        "distance_m": float(np.hypot(*to_robot.T).mean()),
        "seen_percent": dict(zip(JOINTS, shares, strict=True)),
    }


def _messages(
    recording: Recording, run: int | None, robot: str
) -> tuple[int, int, dict[str, list[Message]]]:
    """Return a run, its seed and its messages by key; raises as `read_walk`."""
    topics = {topic.key: topic for topic in (ODOM, SKELETONS, TARGET_SKELETON)}
    runs: dict[int, tuple[int, dict[str, list[Message]]]] = {}
    for sample in recording.samples():
        if sample.stamp is None:
            continue
        number = sample.stamp.run
        name, key = split_key(sample.key, recording.robots(number))
        if name == robot and key in topics:
            _, messages = runs.setdefault(number, (sample.stamp.seed, {key: [] for key in topics}))
            with recording.reading(sample):
                messages[key].append(sample.message(topics[key].type))
    if run is None:
        run = next(reversed(runs), 0)
    if run not in runs:
        known = ", ".join(map(str, runs)) or "none"
        problem = f"no body in run {run}; runs with one: {known}{recording.hint(SKELETONS.key)}"
        raise RecordingError(f"{recording.path}: {problem}")
    seed, messages = runs[run]
    for topic in (ODOM, SKELETONS):
        if not messages[topic.key]:
            problem = f"nothing on {topic.key} in run {run}{recording.hint(topic.key)}"
            raise RecordingError(f"{recording.path}: {problem}")
    return run, seed, messages


def _walked(seen: Motion) -> npt.NDArray[np.int64] | None:
    """Return the frames of the longest walk; None if it is shorter than 3 s."""
    joints = smooth(unswapped(seen))
    if joints is None:
        return None
    path = lowpass(joints[:, 0, :2], seen.rate_hz, PATH_HZ)
    walks = np.hypot(*np.gradient(path, axis=0).T) * seen.rate_hz > WALKS_M_S
    edges = np.flatnonzero(np.diff(np.concatenate(([False], walks, [False])).astype(int)))
    parts = edges.reshape(-1, 2).tolist()
    begin, end = max(parts, key=lambda part: part[1] - part[0], default=(0, 0))
    begin, end = begin + round(BEGIN_S * seen.rate_hz), end - round(END_S * seen.rate_hz)
    return np.arange(begin, end) if end - begin >= 3.0 * seen.rate_hz else None
