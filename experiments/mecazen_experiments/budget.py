"""The error budget: the parts of the following errors from control and from estimation.

docs/results.md explains the oracle and the smoother.
"""

from __future__ import annotations

import math

import numpy as np
from mecazen.config import Scenario
from mecazen.geometry import Pose2D
from mecazen_target.sensor import Sensor
from mecazen_tools.observe import observe
from mecazen_tools.table import Poses, Table

from mecazen_experiments.jobs import Job
from mecazen_experiments.report import Kind, Record, Row
from mecazen_experiments.scores import Scores
from mecazen_experiments.smoother import Sight, least_errors
from mecazen_experiments.tables import Column

COLUMNS: tuple[Column, ...] = (
    ("D_err \\[m]", "d_err_m", 4),
    ("by\ncontrol", "control_d_err_m", 4),
    ("Θ_err \\[°]", "theta_err_deg", 2),
    ("by\ncontrol", "control_theta_err_deg", 2),
    ("estimate\nposition \\[m]", "filter_position_m", 4),
    ("least by\nsmoothing", "smoother_position_m", 4),
    ("estimate\nyaw \\[°]", "filter_yaw_deg", 2),
    ("least by\nsmoothing", "smoother_yaw_deg", 2),
)
ORACLE = 'programs.follower="mecazen_experiments.oracle:OracleFollower"'


def _measure(job: Job) -> tuple[dict[str, float], str]:
    scenario = job.load()
    found = observe(scenario)
    position_m, yaw_deg = least_errors(*sights(scenario, found.table))
    return {"position_m": position_m, "yaw_deg": yaw_deg}, found.trajectory_sha256


BOUND = Kind("bound", Record[dict[str, float]], _measure, dict)
"""The least errors that smoothing could reach with the follower's observations."""


def sights(scenario: Scenario, table: Table) -> tuple[list[Sight], Poses]:
    """Return the observations of a run's follower, in odom, and the true poses at these times.

    The sensor is evaluated again: its noise comes from the seed. The true person is placed in
    odom by the robot's odometry, as in `scores.score`.
    """
    config = scenario.sensor
    sensor = Sensor(config, scenario.seed, scenario.sim.tick_s)
    stds = config.position_std_m, config.position_std_m, math.radians(config.yaw_std_deg)
    noise = np.diag(np.square(stds))
    robots, odoms, persons = (
        [Pose2D(*row) for row in np.transpose(table.poses(who)).tolist()]
        for who in ("robot", "odom", "target")
    )
    seen, ticks = [], []
    for tick, (robot, person) in enumerate(zip(robots, persons, strict=True)):
        frame = sensor.observe(tick, robot, person)
        if frame is None or frame.pose is None:
            continue
        pose, covariance = frame.pose, noise
        if config.frame == "base_link":
            base = odoms[frame.capture_tick]
            c, s = math.cos(base.yaw), math.sin(base.yaw)
            turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            pose, covariance = base.compose(pose), turn @ noise @ turn.T
        seen.append(Sight(frame.capture_tick * table.tick_s, pose, covariance))
        ticks.append(frame.capture_tick)
    at = table.where(np.array(ticks))
    return seen, at.poses("odom").compose(at.poses("robot").between(at.poses("target")))


def budget(runs: Row[Scores], oracle: Row[Scores], bounds: Row[dict[str, float]]) -> Row[Scores]:
    """Return the budget of a case: the errors of the runs, of the oracle and of smoothing."""
    means = {
        "d_err_m": runs.means["d_err_m"],
        "control_d_err_m": oracle.means["d_err_m"],
        "theta_err_deg": runs.means["theta_err_deg"],
        "control_theta_err_deg": oracle.means["theta_err_deg"],
        "filter_position_m": runs.means["estimate_position_err_m"],
        "smoother_position_m": bounds.means["position_m"],
        "filter_yaw_deg": runs.means["estimate_yaw_err_deg"],
        "smoother_yaw_deg": bounds.means["yaw_deg"],
    }
    return Row(runs.name, means, runs.runs)
