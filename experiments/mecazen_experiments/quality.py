"""Quality of a captured walk: angles, gait and visibility against the truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from statistics import fmean
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from mecazen.errors import ConfigError
from mecazen.geometry import Standoff
from mecazen.skeleton import ANGLES, JOINTS, SIDES
from mecazen_tools.table import Floats, first_motion

from mecazen_experiments.capture import SEEN, Capture, angles, capture
from mecazen_experiments.gait.parameters import Gait
from mecazen_experiments.gait.stages import Stage, seen_stages, true_stage
from mecazen_experiments.scores import score

if TYPE_CHECKING:
    from mecazen_experiments.expansion import Job

SETTLING_S = 2.5
"""Time from the person's first motion until the walk is steady and the robot is in place."""
MEASURED = ("hip", "knee", "ankle")
STAGES = ("raw", "filtered", "refined")
"""Stages of a walk: as reported; without swaps and low-passed; the result of `refine`."""

Columns = dict[str, float | str | None]


def _error(name: str) -> Callable[[Gait, Gait], float]:
    return lambda gait, true: gait.mean(name) - true.mean(name)


GAIT_ERRORS: Mapping[str, Callable[[Gait, Gait], float]] = {
    "speed_err_percent": lambda gait, true: (
        100.0 * _error("speed_m_s")(gait, true) / true.mean("speed_m_s")
    ),
    "stride_time_err_ms": lambda gait, true: 1e3 * abs(_error("stride_time_s")(gait, true)),
    "stride_length_err_mm": lambda gait, true: 1e3 * abs(_error("stride_length_m")(gait, true)),
    "cadence_err_percent": lambda gait, true: (
        100.0 * abs(_error("cadence_per_min")(gait, true)) / true.mean("cadence_per_min")
    ),
    "stance_err_percent": _error("stance_percent"),
    "double_support_err_percent": _error("double_support_percent"),
    "step_width_err_mm": lambda gait, true: 1e3 * _error("step_width_m")(gait, true),
    "clearance_err_mm": lambda gait, true: 1e3 * _error("clearance_m")(gait, true),
    "asymmetry_err_percent": lambda gait, true: abs(
        gait.asymmetry_percent("step_time_s") - true.asymmetry_percent("step_time_s")
    ),
}
"""Errors of the refined gait; those of stride, cadence and asymmetry are magnitudes."""
GAITS: Mapping[str, Callable[[Gait], float]] = {
    "stride_m": lambda gait: gait.mean("stride_length_m"),
    "cadence": lambda gait: gait.mean("cadence_per_min"),
    "step_time_percent": lambda gait: gait.asymmetry_percent("step_time_s"),
    "step_length_percent": lambda gait: gait.asymmetry_percent("step_length_m"),
    "stance_percent": lambda gait: gait.difference("stance_percent"),
}
"""Parameters of the true and of the refined gait; percentages are differences of the sides."""


class CapturedWalk(NamedTuple):
    """A captured walk from the time at which it is steady."""

    captured: Capture
    stages: dict[str, Stage]
    """The walk by stage: `truth`, and those of `STAGES` that can be computed."""

    @property
    def angles(self) -> dict[str, Floats]:
        """Sagittal angles (n, 6) [deg] by stage, in the order of `mecazen.skeleton.ANGLES`.

        NaN where no body was reported.
        """
        known = {name: angles(self.stages[name].joints) for name in STAGES if name in self.stages}
        return {"truth": angles(self.captured.truth_at_frames.joints), **known}


def mocap(job: Job) -> Columns:
    """Simulate a job; return the quality of its capture, and the hash of its trajectory."""
    scenario = job.load()
    captured = capture(scenario)
    trajectory = captured.trajectory_sha256[:16]
    return {**quality(captured, scenario.follower.standoff), "trajectory": trajectory}


def walk_of(captured: Capture) -> CapturedWalk:
    """Return a captured walk from the time at which it is steady."""
    first = first_motion(captured.table)
    begin_s = math.inf if first is None else captured.table["t_s"][first] + SETTLING_S
    captured = captured.since(begin_s)
    return CapturedWalk(
        captured, {"truth": true_stage(captured.truth), **seen_stages(captured.seen)}
    )


def quality(captured: Capture, standoff: Standoff) -> Columns:
    """Return the scores of a capture in which the robot had to keep `standoff`.

    `STAGE_JOINT_deg` is the root mean square error of an angle of both legs, and with `centred`
    that without the mean error of each leg; `STAGE_jitter_mm` the root mean square of the second
    difference from frame to frame over all joints.
    """
    walk = walk_of(captured)
    true, refined = walk.stages["truth"], walk.stages.get("refined")
    if true.gait is None:
        raise ConfigError("nobody takes two strides; is sim.duration_s too short?")
    seen, by_stage = walk.captured.seen, walk.angles
    columns: Columns = {}
    for stage in STAGES:
        errors = None
        if stage in by_stage and seen.reported.any():
            errors = (by_stage[stage] - by_stage["truth"])[seen.reported]
        columns |= _angle_errors(stage, errors)
        known = walk.stages.get(stage)
        columns[f"{stage}_jitter_mm"] = None if known is None else _jitter_mm(known.joints)
    columns |= _gait_errors(true, walk.stages.get("filtered"), refined)
    for name, stage in (("true", "truth"), ("refined", "refined")):
        for side in SIDES:
            flexion = by_stage[stage][:, ANGLES.index(f"{side}_knee")] if stage in by_stage else ()
            columns[f"{name}_{side}_knee_deg"] = float(np.max(flexion)) if len(flexion) else None
    shares = dict(zip(JOINTS, (seen.confidence == SEEN).mean(axis=0).tolist(), strict=True))
    for joint in (*MEASURED, "heel", "foot"):
        columns[f"{joint}_seen_percent"] = 100.0 * fmean(shares[f"{s}_{joint}"] for s in SIDES)
    following = score(walk.captured.table, standoff)
    for name in ("d_err_m", "theta_err_deg", "odometry_drift_percent"):
        columns[name] = following[name]
    return columns


def _angle_errors(stage: str, errors: Floats | None) -> Columns:
    columns: Columns = {}
    for suffix, values in (
        ("deg", errors),
        ("centred_deg", None if errors is None else errors - errors.mean(axis=0)),
    ):
        squares = None if values is None else np.mean(values**2, axis=0).tolist()
        for joint in MEASURED:
            legs = [ANGLES.index(f"{side}_{joint}") for side in SIDES]
            rms = None if squares is None else math.sqrt(fmean(squares[leg] for leg in legs))
            columns[f"{stage}_{joint}_{suffix}"] = rms
    return columns


def _gait_errors(true: Stage, filtered: Stage | None, refined: Stage | None) -> Columns:
    """Return the errors of the refined gait; variability is that of the filtered joints."""
    truth = true.gait
    assert truth is not None
    gait = None if refined is None else refined.gait
    before = None if filtered is None else filtered.gait
    columns: Columns = {
        name: None if gait is None else error(gait, truth) for name, error in GAIT_ERRORS.items()
    }
    for prefix, each in (("true", truth), ("refined", gait)):
        for name, value in GAITS.items():
            columns[f"{prefix}_{name}"] = None if each is None else value(each)
    spreads = []
    for prefix, each in (("true", truth), ("filtered", before)):
        sd = None if each is None else each.sd("stride_time_s")
        columns[f"{prefix}_stride_time_sd_ms"] = None if sd is None else 1e3 * sd
        spreads.append(sd)
    known = [sd for sd in spreads if sd is not None]
    columns["stride_time_sd_err_ms"] = 1e3 * (known[1] - known[0]) if len(known) == 2 else None
    late: tuple[float | None, float | None] = (None, None)
    if refined is not None and refined.events is not None and true.events is not None:
        late = refined.events.less(true.events)
    for name, seconds in zip(("strike", "off"), late, strict=True):
        columns[f"{name}_err_ms"] = None if seconds is None else 1e3 * seconds
    return columns


def _jitter_mm(joints: Floats) -> float | None:
    squares = (np.diff(joints, n=2, axis=0) ** 2).sum(axis=-1)
    known = squares[~np.isnan(squares)]
    return 1e3 * math.sqrt(known.mean()) if known.size else None
