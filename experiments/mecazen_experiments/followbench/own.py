"""A run of table B: safety of our robot among people, and accuracy of the measured gait."""

from __future__ import annotations

import msgspec
import numpy as np
from mecazen.config import Scenario
from mecazen.skeleton import INDEX
from mecazen_tools.observe import Watched
from mecazen_tools.table import Poses

from mecazen_experiments.capture import Motion, motion_of
from mecazen_experiments.gait.path import PATH_HZ, lowpass
from mecazen_experiments.gait.stages import seen_stages, true_stage
from mecazen_experiments.safety_old import COLUMNS as SAFETY_COLUMNS
from mecazen_experiments.safety_old import Safety, safety
from mecazen_experiments.tables_old import Column

WALKS_M_S = 0.5
"""Speed below which a person has stopped: strides are measured in the longest walk without a
stop."""
LEAST_FRAMES = 50
"""Minimum number of frames of a walk whose strides are measured: 2 s."""
COLUMNS: tuple[Column, ...] = (
    *SAFETY_COLUMNS,
    ("stride\n\\[ms]", "stride_time_err_ms", 0),
    ("stride\n\\[mm]", "stride_length_err_mm", 0),
)


class OwnRun(Safety, frozen=True):
    """The measures of a run of table B; None if the robot saw no stride of each leg."""

    stride_time_err_ms: float | None
    """Error of the mean stride time that the robot measured."""
    stride_length_err_mm: float | None


def own_run(seen: Watched, scenario: Scenario) -> OwnRun:
    """Return the measures of a run."""
    odom = seen.table.poses("odom")
    joints = motion_of(seen.frames)
    placed = joints.placed(Poses(*(column[seen.table.ticks(joints.t)] for column in odom)))
    truth = motion_of([(body.header, body) for body in seen.bodies])
    seconds, metres = stride_errors(truth, placed)
    return OwnRun(
        **msgspec.structs.asdict(safety(seen, scenario)),
        stride_time_err_ms=None if seconds is None else 1e3 * seconds,
        stride_length_err_mm=None if metres is None else 1e3 * metres,
    )


def stride_errors(truth: Motion, seen: Motion) -> tuple[float | None, float | None]:
    """Return the errors of the mean stride time [s] and length [m] in the longest walk."""
    begin, end = longest_walk(truth)
    truth, found = (
        motion.where((motion.t >= begin) & (motion.t <= end)) for motion in (truth, seen)
    )
    if len(found.t) < LEAST_FRAMES:
        return None, None
    true = true_stage(truth).gait
    stages = seen_stages(found)
    seen_gait = stages["refined"].gait if "refined" in stages else None
    if true is None or seen_gait is None:
        return None, None
    time, length = (
        abs(seen_gait.mean(name) - true.mean(name)) for name in ("stride_time_s", "stride_length_m")
    )
    return time, length


def longest_walk(truth: Motion) -> tuple[float, float]:
    """Return the first and last time [s] of the longest part in which a person does not stop."""
    pelvis = lowpass(truth.joints[:, INDEX["pelvis"], :2], truth.rate_hz, PATH_HZ)
    speeds = np.hypot(*np.gradient(pelvis, axis=0).T) * truth.rate_hz
    stops = np.flatnonzero(np.concatenate(([True], speeds < WALKS_M_S, [True])))
    longest = int(np.argmax(np.diff(stops)))
    first, last = stops[longest], stops[longest + 1] - 2
    return float(truth.t[min(first, len(truth.t) - 1)]), float(truth.t[max(last, 0)])
