"""Quality of a captured walk: angles, gait and visibility against the truth."""

from __future__ import annotations

import math
from statistics import fmean
from typing import NamedTuple

import msgspec
import numpy as np
from mecazen.errors import ConfigError
from mecazen.geometry import Standoff
from mecazen.skeleton import ANGLES, JOINTS, SIDES
from mecazen_tools.table import Floats, first_motion

from mecazen_experiments.capture import SEEN, Capture, angles
from mecazen_experiments.gait.parameters import Gait
from mecazen_experiments.gait.stages import Stage, seen_stages, true_stage
from mecazen_experiments.scores import score

SETTLING_S = 2.5
"""Time from the person's first motion until the walk is steady and the robot is in place."""
MEASURED = ("hip", "knee", "ankle")
STAGES = ("raw", "filtered", "refined")


class Quality(msgspec.Struct, frozen=True):
    """Quality of gait capture in one run; None if a value can't be computed from the reports.

    Stages are `raw`, as reported; `filtered`, without swaps and low-passed; and `refined`, the
    result of `refine`.
    """

    rmse_deg: dict[str, dict[str, float] | None]
    """Root mean square error of hip, knee and ankle angle of both legs, by stage."""
    centred_deg: dict[str, dict[str, float] | None]
    """The same without the mean error of each leg."""
    jitter_mm: dict[str, float | None]
    """Root mean square over all joints of the second difference from frame to frame."""
    truth: Gait
    """True gait, by the planted feet."""
    filtered: Gait | None
    """Gait by events in the filtered joints, from which variability is taken."""
    observed: Gait | None
    """Gait by events in the refined joints."""
    event_errors_s: tuple[float | None, float | None] | None
    """Mean errors of strikes and of offs in the refined joints."""
    knee_flexion_deg: dict[str, dict[str, float]]
    """The largest flexion of each side's knee, `true` and `found` in the refined joints."""
    seen: dict[str, float]
    """Share of the frames in which each joint is in view and not hidden."""
    d_err_m: float | None
    """As in `Score`."""
    theta_err_deg: float | None
    odometry_drift_percent: float | None


class Curves(NamedTuple):
    """Sagittal angles at frames."""

    phases: Floats
    """Share of the gait cycle since heel strike (n, 2), left and right."""
    angles: dict[str, Floats]
    """Angles of `truth` and of each stage (n, 6) [deg], in the order of `mecazen.skeleton.ANGLES`.

    NaN where no body was reported.
    """


def quality(found: Capture, wanted: Standoff) -> tuple[Quality, Curves]:
    """Return the scores and curves of a capture in which the robot had to keep `wanted`."""
    found = steady(found)
    estimated = all_stages(found)
    truth_stage = estimated["truth"]
    gait = truth_stage.gait
    if gait is None:
        raise ConfigError("nobody takes two strides; is sim.duration_s too short?")
    seen, true = found.seen, found.truth_at_frames
    filtered, refined = estimated.get("filtered"), estimated.get("refined")
    stages = {name: estimated[name].joints if name in estimated else None for name in STAGES}
    truth = angles(true.joints)
    of = {stage: None if joints is None else angles(joints) for stage, joints in stages.items()}
    errors = {
        stage: None if each is None or not seen.reported.any() else (each - truth)[seen.reported]
        for stage, each in of.items()
    }
    following = score(found.table, wanted).whole
    shares = (seen.confidence == SEEN).mean(axis=0).tolist()
    scores = Quality(
        {stage: None if e is None else _rms(e) for stage, e in errors.items()},
        {stage: None if e is None else _rms(e - e.mean(axis=0)) for stage, e in errors.items()},
        {stage: None if each is None else _jitter_mm(each) for stage, each in stages.items()},
        gait,
        None if filtered is None else filtered.gait,
        None if refined is None else refined.gait,
        _event_errors(refined, truth_stage),
        {
            name: _knee_flexion(each)
            for name, each in (("true", truth), ("found", of["refined"]))
            if each is not None
        },
        dict(zip(JOINTS, shares, strict=True)),
        following.d_err_m,
        following.theta_err_deg,
        following.odometry_drift_percent,
    )
    known = {stage: each for stage, each in of.items() if each is not None}
    return scores, Curves(true.phases, {"truth": truth, **known})


def steady(found: Capture) -> Capture:
    """Return the capture from the time at which the walk is steady."""
    first = first_motion(found.table)
    return found.since(math.inf if first is None else found.table["t_s"][first] + SETTLING_S)


def all_stages(found: Capture) -> dict[str, Stage]:
    """Return the true and the reported walk, by stage."""
    return {"truth": true_stage(found.truth), **seen_stages(found.seen)}


def numbers(of: Quality) -> dict[str, float | None]:
    """Return the scores by name; some errors of the gait are magnitudes, others are signed."""
    following = ("d_err_m", "theta_err_deg", "odometry_drift_percent")
    values: dict[str, float | None] = {name: getattr(of, name) for name in following}
    for name, by_stage in (("deg", of.rmse_deg), ("centred_deg", of.centred_deg)):
        for stage, errors in by_stage.items():
            values |= {f"{stage}_{joint}_{name}": v for joint, v in (errors or {}).items()}
    values |= {f"{stage}_jitter_mm": value for stage, value in of.jitter_mm.items()}
    if of.observed is not None:
        found, true = of.observed, of.truth
        for name, gait in (("true", true), ("found", found)):
            values |= {
                f"{name}_stride_m": gait.mean("stride_length_m"),
                f"{name}_cadence": gait.mean("cadence_per_min"),
                f"{name}_step_time_percent": gait.asymmetry_percent("step_time_s"),
                f"{name}_step_length_percent": gait.asymmetry_percent("step_length_m"),
                f"{name}_stance_percent": gait.difference("stance_percent"),
            }

        def off(name: str) -> float:
            return found.mean(name) - true.mean(name)

        step_times = [gait.asymmetry_percent("step_time_s") for gait in (found, true)]
        values |= {
            "speed_err_percent": 1e2 * off("speed_m_s") / true.mean("speed_m_s"),
            "stride_time_err_ms": 1e3 * abs(off("stride_time_s")),
            "stride_length_err_mm": 1e3 * abs(off("stride_length_m")),
            "cadence_err_percent": 1e2 * abs(off("cadence_per_min")) / true.mean("cadence_per_min"),
            "stance_err_percent": off("stance_percent"),
            "double_support_err_percent": off("double_support_percent"),
            "step_width_err_mm": 1e3 * off("step_width_m"),
            "clearance_err_mm": 1e3 * off("clearance_m"),
            "asymmetry_err_percent": abs(step_times[0] - step_times[1]),
        }
    if of.filtered is not None:
        spreads = [gait.sd("stride_time_s") for gait in (of.filtered, of.truth)]
        values |= {
            f"{name}_stride_time_sd_ms": None if sd is None else 1e3 * sd
            for name, sd in zip(("found", "true"), spreads, strict=True)
        }
        if None not in spreads:
            values["stride_time_sd_err_ms"] = 1e3 * (spreads[0] - spreads[1])  # type: ignore[operator]
    if of.event_errors_s is not None:
        for name, seconds in zip(("strike", "off"), of.event_errors_s, strict=True):
            values[f"{name}_err_ms"] = None if seconds is None else 1e3 * seconds
    for name, knees in of.knee_flexion_deg.items():
        values |= {f"{name}_{side}_knee_deg": knees[side] for side in SIDES}
    for joint in (*MEASURED, "heel", "foot"):
        values[f"{joint}_seen_percent"] = 1e2 * fmean(of.seen[f"{s}_{joint}"] for s in SIDES)
    return values


def _event_errors(found: Stage | None, true: Stage) -> tuple[float | None, float | None] | None:
    """Return the mean errors of strikes and offs [s]."""
    if found is None or found.events is None or true.events is None:
        return None
    return found.events.less(true.events)


def _rms(errors: Floats) -> dict[str, float]:
    """Return the root mean squares of errors (n, 6) of both legs, by joint."""
    squares = dict(zip(ANGLES, np.mean(errors**2, axis=0).tolist(), strict=True))
    return {joint: math.sqrt(fmean(squares[f"{s}_{joint}"] for s in SIDES)) for joint in MEASURED}


def _knee_flexion(angles: Floats) -> dict[str, float]:
    """Return the largest flexion of each side's knee, from angles (n, 6)."""
    return {side: float(angles[:, ANGLES.index(f"{side}_knee")].max()) for side in SIDES}


def _jitter_mm(joints: Floats) -> float | None:
    squares = (np.diff(joints, n=2, axis=0) ** 2).sum(axis=-1)
    known = squares[~np.isnan(squares)]
    return 1e3 * math.sqrt(known.mean()) if known.size else None
