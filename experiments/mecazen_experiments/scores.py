"""Scores of a run: following, smoothness and estimation."""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import fmean
from typing import TYPE_CHECKING, SupportsFloat

import numpy as np
import numpy.typing as npt
from mecazen.geometry import Pose2D, Standoff
from mecazen_follower.tracker import TrackingState
from mecazen_tools.observe import observe
from mecazen_tools.table import Floats, Poses, Table, deviations, first_motion, wrap
from mecazen_tools.trajectory import COVARIANCE, LOST

if TYPE_CHECKING:
    from mecazen_experiments.expansion import Job

SETTLING_S = 5.0
"""Time from the first motion of the person until the robot should have caught up."""
WALKING_M_S = 0.2
"""Speed below which a person hardly walks: the heading of a recorded one is held there."""
MIN_PATH_M = 0.1
"""Minimum length of a path for which drift is computed."""


Measures = dict[str, float | None]
"""Measures of a run by name, as in docs/experiments.md; None if there is nothing to measure."""


def following(job: Job) -> dict[str, float | str | None]:
    """Simulate a job; return its scores, and the hash of its trajectory."""
    scenario = job.load()
    observed = observe(scenario)
    standoff = scenario.follower.standoff
    settled = score(observed.table, standoff, SETTLING_S)
    return {
        **score(observed.table, standoff),
        "settled_d_err_m": settled["d_err_m"],
        "settled_theta_err_deg": settled["theta_err_deg"],
        "trajectory": observed.trajectory_sha256[:16],
    }


def score(table: Table, standoff: Standoff, after_s: float = 0.0) -> Measures:
    """Return the measures of a run in which the robot had to keep `standoff`.

    They begin a time after the first motion of the person. All are None if there is no person, or
    if the person never moves. Estimates are in odom, which drifts. Their truth is the person's pose
    relative to the true robot, transformed to odom with the robot's odometry.
    """
    first = first_motion(table)
    begin = len(table) if first is None else first + round(after_s / table.tick_s)
    table = table.where(slice(begin, None))
    robot, person = table.poses("robot"), table.poses("target")
    goal = person.compose(standoff.goal(Pose2D()))
    distance, bearing, yaw = map(abs, deviations(table, standoff))
    acceleration = np.diff(_velocity(table, "robot") * np.exp(1j * robot.yaw)) / table.tick_s
    estimated = table.where(~np.isnan(table["estimate_x_m"] + table["odom_x_m"]))
    error, covariances = _estimate_errors(estimated)
    speed = abs(_velocity(estimated, "estimate")) - abs(_velocity(estimated, "target"))
    consistency = nees(np.stack(error, axis=-1), covariances)
    commanded = table.where(~np.isnan(table["cmd_vx_m_s"]))
    walking = abs(_velocity(table, "target")) >= WALKING_M_S
    return {
        **{f"d_{name}_m": _of(measure, distance) for name, measure in MEASURES.items()},
        **{
            f"theta_{name}_deg": _of(measure, np.degrees(yaw)) for name, measure in MEASURES.items()
        },
        "theta_walking_deg": _of(np.mean, np.degrees(yaw[walking])),
        "theta_hardly_walking_deg": _of(np.mean, np.degrees(yaw[~walking])),
        "bearing_err_deg": _of(np.mean, np.degrees(bearing)),
        "goal_err_m": _of(np.mean, np.hypot(robot.x - goal.x, robot.y - goal.y)),
        "min_distance_m": _of(np.min, np.hypot(robot.x - person.x, robot.y - person.y)),
        "acceleration_rms_m_s2": _of(_rms, abs(acceleration)),
        "jerk_rms_m_s3": _of(_rms, abs(np.diff(acceleration)) / table.tick_s),
        "command_variation_m_s2": _variation(commanded, _velocity(commanded, "cmd")),
        "yaw_command_variation_rad_s2": _variation(commanded, commanded["cmd_yaw_rate_rad_s"]),
        "estimate_position_err_m": _of(np.mean, np.hypot(error.x, error.y)),
        "estimate_yaw_err_deg": _of(np.mean, np.degrees(abs(error.yaw))),
        "estimate_speed_err_m_s": _of(np.mean, abs(speed)),
        "nees": _of(np.mean, consistency),
        "nees_p95": _of(_p95, consistency),
        "coasting_s": _time(table, TrackingState.COASTING),
        "lost_s": _time(table, *LOST),
        "odometry_drift_percent": _drift(table.where(~np.isnan(table["odom_x_m"]))),
    }


def nees(errors: Floats, covariances: Floats) -> Floats:
    """Return the normalised estimation error squared, eᵀ P⁻¹ e, of every tick.

    Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation,
    section 5.4.2. Errors are n×k, covariances n×k×k. The result (n) is NaN if a covariance is not
    positive definite: zeros mean unknown.
    """
    variances, axes = np.linalg.eigh(covariances)
    variances[variances[:, 0] <= 0.0] = np.nan
    along = np.einsum("nij,ni->nj", axes, errors)
    return np.asarray((along**2 / variances).sum(axis=1))


def _velocity(table: Table, who: str) -> npt.NDArray[np.complex128]:
    """Return the planar velocities [m/s] of the table as complex numbers, with y imaginary."""
    return table[f"{who}_vx_m_s"] + 1j * table[f"{who}_vy_m_s"]


def _estimate_errors(table: Table) -> tuple[Poses, Floats]:
    """Return the estimated minus the true pose along the axes of odom, and n×3×3 covariances."""
    seen = table.poses("robot").between(table.poses("target"))
    truth, estimate = table.poses("odom").compose(seen), table.poses("estimate")
    error = Poses(estimate.x - truth.x, estimate.y - truth.y, wrap(estimate.yaw - truth.yaw))
    xx, xy, xyaw, yy, yyaw, yawyaw = (table[f"estimate_{name}"] for name in COVARIANCE)
    rows = [[xx, xy, xyaw], [xy, yy, yyaw], [xyaw, yyaw, yawyaw]]
    return error, np.moveaxis(np.array(rows), -1, 0)


def _variation(table: Table, command: Floats | npt.NDArray[np.complex128]) -> float | None:
    """Return the total variation of a command per second."""
    if len(table) < 2:
        return None
    t = table["t_s"]
    return float(abs(np.diff(command)).sum() / (t[-1] - t[0]))


def _time(table: Table, *states: str) -> float | None:
    """Return the time in some states [s]; a state holds until the next report."""
    reported = table.tracking[table.tracking != ""]
    share = _of(np.mean, np.isin(reported, states).astype(np.float64))
    return None if share is None else share * len(table) * table.tick_s


def _drift(table: Table) -> float | None:
    """Return the error of the odometry's displacement, relative to the true path [%].

    Both displacements are in the frame of their start. None for a path below `MIN_PATH_M`.
    """
    robot, odom = table.poses("robot"), table.poses("odom")
    path = float(np.hypot(np.diff(robot.x), np.diff(robot.y)).sum())
    if path < MIN_PATH_M:
        return None
    true = robot.at(0).between(robot.at(-1))
    believed = odom.at(0).between(odom.at(-1))
    return 100.0 * true.distance(believed) / path


def _of(measure: Callable[[Floats], SupportsFloat], values: Floats) -> float | None:
    """Return a measure of the `values` that are not NaN; None if there are none."""
    numbers = values[~np.isnan(values)]
    return float(measure(numbers)) if numbers.size else None


def _rms(values: Floats) -> float:
    return math.sqrt(np.mean(values**2))


def _p95(values: Floats) -> SupportsFloat:
    return np.percentile(values, 95.0)


MEASURES: dict[str, Callable[[Floats], SupportsFloat]] = {
    "err": fmean,
    "rms": _rms,
    "p95": _p95,
    "max": np.max,
}
"""Measures of the magnitude of an error."""
