"""The walk of a recording: reported joints, view, and the truth if it was recorded."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.keys import ODOM, SKELETONS, TARGET_SKELETON
from mecazen.messages import Message
from mecazen.robots import split_key
from mecazen.skeleton import JOINTS
from mecazen_recorder.reader import Recording
from mecazen_recorder.writer import RecordingError
from mecazen_tools.table import Poses

from mecazen_experiments.capture import SEEN, Motion, motions
from mecazen_experiments.gait.path import PATH_HZ, lowpass
from mecazen_experiments.gait.stages import Stage, seen_stages, true_stage
from mecazen_experiments.refine import smooth

WALKS_M_S = 0.25
"""Speed along the path above which a person walks."""
BEGIN_S, END_S = 1.5, 0.5
"""Times left out at the beginning and end of a walk, while the speed changes [s]."""
VIEWS = ("front", "front left", "left", "back left", "back", "back right", "right", "front right")


class RecordedWalk(NamedTuple):
    """The longest walk of a recorded run."""

    stages: dict[str, Stage]
    """`raw`, `filtered`, `refined` and, if it was recorded, `truth`."""
    run: int
    seed: int
    bearing_deg: float
    """Direction to the robot, relative to straight ahead of the person; positive to the left."""
    distance_m: float
    """Mean distance from the pelvis to the robot."""
    seen_percent: dict[str, float]
    """Share of the frames in which each joint is in view and not hidden."""
    reported_percent: float
    """Share of the frames with a body."""

    @property
    def view(self) -> str:
        """The side of the person that the robot sees."""
        return VIEWS[round(self.bearing_deg / 45.0) % len(VIEWS)]


def read_walk(recording: Recording, run: int | None, robot: str = "") -> RecordedWalk:
    """Return the longest walk of a run, by default of the last one.

    Raises:
        RecordingError: There is no such run, or the data of the body tracker was not recorded.
    """
    topics = {topic.key: topic for topic in (ODOM, SKELETONS, TARGET_SKELETON)}
    runs: dict[int, tuple[int, dict[str, list[Message]]]] = {}
    for sample in recording.samples():
        if sample.stamp is None:
            continue
        number = sample.stamp.run
        whose, key = split_key(sample.key, recording.robots(number))
        if whose == robot and key in topics:
            _, found = runs.setdefault(number, (sample.stamp.seed, {name: [] for name in topics}))
            with recording.reading(sample):
                found[key].append(sample.message(topics[key].type))
    wanted = run if run is not None else max(runs, default=0)
    if wanted not in runs:
        known = ", ".join(map(str, runs)) or "none"
        raise RecordingError(f"{recording.path}: no body in run {wanted}; runs with one: {known}")
    seed, messages = runs[wanted]
    for topic in (ODOM, SKELETONS):
        if not messages[topic.key]:
            raise RecordingError(f"{recording.path}: nothing on {topic.key} in run {wanted}")
    truth, seen = motions(messages[TARGET_SKELETON.key], messages[SKELETONS.key])  # type: ignore[arg-type]
    odom = [(m.header.stamp.ns / 1e9, *m.pose.pose.to_planar()) for m in messages[ODOM.key]]  # type: ignore[attr-defined]
    times, *columns = np.array(odom).T
    seen = seen.evenly()
    at = np.minimum(np.searchsorted(times, seen.t - 1e-6), len(times) - 1)
    robots = Poses(*(column[at] for column in columns))
    seen = seen.placed(robots)
    rows = _walked(seen)
    if rows is None:
        raise RecordingError(f"{recording.path}: nobody walks for 3 s in run {wanted}")
    seen, robots = seen.where(rows), Poses(*(column[rows] for column in robots))
    stages = seen_stages(seen)
    if len(truth.t):
        inside = (truth.t >= seen.t[0]) & (truth.t <= seen.t[-1])
        stages = {"truth": true_stage(truth.where(inside)), **stages}
    pelvis = seen.joints[seen.reported, 0, :2]
    way = pelvis[-1] - pelvis[0]
    to_robot = np.stack((robots.x, robots.y), axis=-1)[seen.reported] - pelvis
    dx, dy = to_robot.mean(axis=0)
    bearing = math.atan2(way[0] * dy - way[1] * dx, way[0] * dx + way[1] * dy)
    shares = (1e2 * (seen.confidence == SEEN).mean(axis=0)).tolist()
    return RecordedWalk(
        stages,
        wanted,
        seed,
        math.degrees(bearing),
        float(np.hypot(*to_robot.T).mean()),
        dict(zip(JOINTS, shares, strict=True)),
        1e2 * float(seen.reported.mean()),
    )


def _walked(seen: Motion) -> npt.NDArray[np.int64] | None:
    """Return the frames of the longest walk; None if it is shorter than 3 s."""
    joints = smooth(seen)
    if joints is None:
        return None
    path = lowpass(joints[:, 0, :2], seen.rate_hz, PATH_HZ)
    walks = np.hypot(*np.gradient(path, axis=0).T) * seen.rate_hz > WALKS_M_S
    edges = np.flatnonzero(np.diff(np.concatenate(([False], walks, [False])).astype(int)))
    begin, end = max(edges.reshape(-1, 2).tolist(), key=lambda one: one[1] - one[0], default=(0, 0))
    begin, end = begin + round(BEGIN_S * seen.rate_hz), end - round(END_S * seen.rate_hz)
    return np.arange(begin, end) if end - begin >= 3.0 * seen.rate_hz else None
