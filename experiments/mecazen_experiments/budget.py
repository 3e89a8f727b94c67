"""The error budget: which part of the following errors comes from control, which from estimation.

docs/results.md tells what the oracle and the smoother show.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from mecazen.config import Scenario
from mecazen.geometry import Pose2D
from mecazen_target.sensor import Sensor
from rich.table import Table as Shown

from mecazen_experiments.jobs import Job, Key, Series
from mecazen_experiments.report import CAPTION, show
from mecazen_experiments.run import Record, simulated
from mecazen_experiments.scores import Score
from mecazen_experiments.smoother import Sight, least_errors
from mecazen_experiments.statistics import Interval, mean_interval
from mecazen_experiments.table import Poses, Table

ORACLE = 'programs.follower="mecazen_experiments.oracle:OracleFollower"'


class Bound(msgspec.Struct, frozen=True):
    """The least mean errors of an estimate that knows all observations."""

    position_m: float
    yaw_deg: float


class Budget(msgspec.Struct, frozen=True):
    """The errors of a case by their cause; means over its runs."""

    name: str
    d_err_m: Interval
    control_d_err_m: Interval
    theta_err_deg: Interval
    control_theta_err_deg: Interval
    filter_position_m: Interval
    smoother_position_m: Interval
    filter_yaw_deg: Interval
    smoother_yaw_deg: Interval


COLUMNS = {
    "d_err_m": ("D_err \\[m]", 4, "runs", "d_err_m"),
    "control_d_err_m": ("by\ncontrol", 4, "oracle", "d_err_m"),
    "theta_err_deg": ("Θ_err \\[°]", 2, "runs", "theta_err_deg"),
    "control_theta_err_deg": ("by\ncontrol", 2, "oracle", "theta_err_deg"),
    "filter_position_m": ("estimate\nposition \\[m]", 4, "runs", "estimate_position_err_m"),
    "smoother_position_m": ("least by\nsmoothing", 4, "bounds", "position_m"),
    "filter_yaw_deg": ("estimate\nyaw \\[°]", 2, "runs", "estimate_yaw_err_deg"),
    "smoother_yaw_deg": ("least by\nsmoothing", 2, "bounds", "yaw_deg"),
}
"""Heading and digits of each field, and the error whose mean it is, in whose runs."""


def bound(job: Job) -> Bound:
    """Simulate a job and smooth what its follower saw.

    Raises:
        MecazenError: As of `run.run`.
    """
    scenario, _, trajectory = simulated(job)
    return Bound(*least_errors(*sights(scenario, Table.of(trajectory))))


def sights(scenario: Scenario, table: Table) -> tuple[list[Sight], Poses]:
    """Return what a run's follower saw, in odom, and the person's true poses at these times.

    The sensor is evaluated again: its noise comes from the seed. The true person is placed in
    odom by the robot's odometry, as of `scores.score`.
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


def budget(
    series: Series, oracle: Series, records: Mapping[Key, Record], bounds: Mapping[Key, Bound]
) -> Budget:
    """Return the budget of a case from its runs, the oracle's and their bounds."""
    errors: dict[str, list[Score] | list[Bound]] = {
        "runs": [records[job.key].scores.whole for job in series.jobs],
        "oracle": [records[job.key].scores.whole for job in oracle.jobs],
        "bounds": [bounds[job.key] for job in series.jobs],
    }
    means = {
        field: mean_interval([getattr(one, error) for one in errors[whose]])
        for field, (_, _, whose, error) in COLUMNS.items()
    }
    return Budget(series.row, **means)


def table(rows: Sequence[Budget]) -> Shown:
    """Return the rows as a table, each mean above its 95 % interval."""
    titles = (title for title, *_ in COLUMNS.values())
    shown = Shown("case", *titles, caption=CAPTION, show_lines=True)
    for row in rows:
        values = (show(getattr(row, name), column[1]) for name, column in COLUMNS.items())
        shown.add_row(row.name, *values)
    return shown
