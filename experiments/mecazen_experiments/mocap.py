"""The program `mocap`: angles, gait and visibility of a captured walk against the truth."""

from __future__ import annotations

import math
from statistics import fmean
from typing import TYPE_CHECKING

import numpy as np
from mecazen.errors import ConfigError
from mecazen.geometry import Standoff
from mecazen.keys import SKELETONS, TARGET_SKELETON
from mecazen.skeleton import ANGLES, JOINTS, SIDES
from mecazen_tools.observe import observe_bodies
from mecazen_tools.table import Floats, Poses, Table, first_motion

from mecazen_experiments.gait.motion import MEASURED, SEEN, Motion, angles, motions
from mecazen_experiments.gait.stages import Stage, seen_stages, true_stage
from mecazen_experiments.gait.strides import PARAMETERS, Gait
from mecazen_experiments.scores import score

if TYPE_CHECKING:
    from mecazen_experiments.expansion import Job

SETTLING_S = 2.5
"""Time from the person's first motion until the walk is steady and the robot is in place."""
STAGES = ("raw", "filtered", "refined")
"""Stages of a walk: as reported; without swaps and low-passed; the result of `refine`."""

Columns = dict[str, float | str | None]


def mocap(job: Job) -> Columns:
    """Simulate a job; return the quality of its capture, and the hash of its trajectory."""
    scenario = job.load()
    run = observe_bodies(scenario)
    truth, seen = motions(run.samples[TARGET_SKELETON.key], run.samples[SKELETONS.key])
    at = run.table.ticks(seen.t)
    seen = seen.placed(Poses(*(column[at] for column in run.table.poses("odom"))))
    columns = quality(run.table, truth, seen, scenario.follower.standoff)
    return {**columns, "trajectory": run.trajectory_sha256[:16]}


def quality(table: Table, truth: Motion, seen: Motion, standoff: Standoff) -> Columns:
    """Return the scores of a capture, from `SETTLING_S` after the first motion on.

    `STAGE_JOINT_deg` is the root mean square error of an angle of both legs, and with `centred`
    that without the mean error of each leg; `STAGE_jitter_mm` the root mean square of the second
    difference from frame to frame over all joints. Errors of the gait are those of the refined
    joints, and its variability is that of the filtered joints.

    Args:
        table: Robot and person at every tick of the whole run.
        truth: True joints in world, at the rate of `sensors.skeleton_rate_hz`.
        seen: Reported joints at the tracker's frames, in odom: the robot knows no other fixed
            frame.
        standoff: The standoff that the robot had to keep.
    """
    first = first_motion(table)
    begin_s = math.inf if first is None else table["t_s"][first] + SETTLING_S
    truth, seen = (motion.where(motion.t >= begin_s) for motion in (truth, seen))
    true, missing = true_stage(truth), Stage(np.empty(0), np.empty((0, len(JOINTS), 3)))
    if true.gait is None:
        raise ConfigError("nobody takes two strides; is sim.duration_s too short?")
    known = seen_stages(seen)
    stages = {name: known.get(name, missing) for name in STAGES}
    _, filtered, refined = stages.values()
    at_frames = truth.where(np.searchsorted(truth.t, seen.t - 1e-6))
    true_angles = angles(at_frames.joints)
    by_stage = {name: angles(stage.joints) for name, stage in known.items()}
    columns: Columns = {}
    for name, stage in stages.items():
        errors = None
        if name in by_stage and seen.reported.any():
            errors = (by_stage[name] - true_angles)[seen.reported]
        columns |= _angle_errors(name, errors)
        columns[f"{name}_jitter_mm"] = _jitter_mm(stage.joints)
    columns |= _gait_errors(refined.gait, true.gait)
    columns |= _parameters("true", true.gait) | _parameters("refined", refined.gait)
    true_sd = true.gait.sd("stride_time_s")
    sd = filtered.gait.sd("stride_time_s") if filtered.gait else None
    columns["true_stride_time_sd_ms"] = _milli(true_sd)
    columns["filtered_stride_time_sd_ms"] = _milli(sd)
    error = None if sd is None or true_sd is None else sd - true_sd
    columns["stride_time_sd_err_ms"] = _milli(error)
    late = refined.events.less(true.events) if refined.events and true.events else (None, None)
    columns["strike_err_ms"], columns["off_err_ms"] = map(_milli, late)
    for name, degrees in (("true", true_angles), ("refined", by_stage.get("refined", ()))):
        for side in SIDES:
            flexion = np.asarray(degrees)[:, ANGLES.index(f"{side}_knee")] if len(degrees) else ()
            columns[f"{name}_{side}_knee_deg"] = float(np.max(flexion)) if len(flexion) else None
    shares = dict(zip(JOINTS, (seen.confidence == SEEN).mean(axis=0).tolist(), strict=True))
    for joint in (*MEASURED, "heel", "foot"):
        columns[f"{joint}_seen_percent"] = 100.0 * fmean(shares[f"{s}_{joint}"] for s in SIDES)
    following = score(table, standoff)
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


def _gait_errors(gait: Gait | None, true: Gait) -> Columns:
    """Return the errors of a gait; those of stride, cadence and asymmetry are magnitudes."""
    if gait is None:
        return dict.fromkeys(_gait_errors(true, true))
    error = {name: gait.mean(name) - true.mean(name) for name in PARAMETERS}
    asymmetry, true_asymmetry = (each.asymmetry_percent("step_time_s") for each in (gait, true))
    return {
        "speed_err_percent": 100.0 * error["speed_m_s"] / true.mean("speed_m_s"),
        "stride_time_err_ms": 1e3 * abs(error["stride_time_s"]),
        "stride_length_err_mm": 1e3 * abs(error["stride_length_m"]),
        "cadence_err_percent": (
            100.0 * abs(error["cadence_per_min"]) / true.mean("cadence_per_min")
        ),
        "stance_err_percent": error["stance_percent"],
        "double_support_err_percent": error["double_support_percent"],
        "step_width_err_mm": 1e3 * error["step_width_m"],
        "clearance_err_mm": 1e3 * error["clearance_m"],
        "asymmetry_err_percent": abs(asymmetry - true_asymmetry),
    }


def _parameters(prefix: str, gait: Gait | None) -> Columns:
    """Return parameters of a gait; percentages are differences of the sides."""
    names = ("stride_m", "cadence", "step_time_percent", "step_length_percent", "stance_percent")
    if gait is None:
        return dict.fromkeys(f"{prefix}_{name}" for name in names)
    values = (
        gait.mean("stride_length_m"),
        gait.mean("cadence_per_min"),
        gait.asymmetry_percent("step_time_s"),
        gait.asymmetry_percent("step_length_m"),
        gait.difference("stance_percent"),
    )
    return {f"{prefix}_{name}": value for name, value in zip(names, values, strict=True)}


def _milli(value: float | None) -> float | None:
    return None if value is None else 1e3 * value


def _jitter_mm(joints: Floats) -> float | None:
    squares = (np.diff(joints, n=2, axis=0) ** 2).sum(axis=-1)
    known = squares[~np.isnan(squares)]
    return 1e3 * math.sqrt(known.mean()) if known.size else None
