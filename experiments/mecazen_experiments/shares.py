"""Who owes what: the shares of control and of estimation in the errors of following.

An oracle that is told the true person drives the same robot by the same law: what it is off
is the control's. A smoother that knows the observations to come shows how much of the
estimate's error no filter can avoid; what the filter is worse is the filter's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from mecazen.config import Scenario
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario
from mecazen_target.sensor import Sensor
from mecazen_tools.simulate import simulate
from rich.table import Table as Shown

from mecazen_experiments.jobs import Job, Key, Series, check_version
from mecazen_experiments.poses import Poses
from mecazen_experiments.report import show
from mecazen_experiments.run import Record
from mecazen_experiments.smoother import Sight, least_errors
from mecazen_experiments.statistics import Interval, mean_interval
from mecazen_experiments.table import Table

ORACLE = 'programs.follower="mecazen_experiments.oracle:OracleFollower"'


class Bound(msgspec.Struct, frozen=True):
    """The least mean errors of an estimate that knows all observations."""

    position_m: float
    yaw_deg: float


class Shares(msgspec.Struct, frozen=True):
    """The errors of a case, and whose they are; means over its runs."""

    name: str
    d_err_m: Interval
    control_d_err_m: Interval
    theta_err_deg: Interval
    control_theta_err_deg: Interval
    filter_position_m: Interval
    smoother_position_m: Interval
    filter_yaw_deg: Interval
    smoother_yaw_deg: Interval


class Report(msgspec.Struct, frozen=True):
    """What `mecazen experiment shares --json` writes."""

    rows: tuple[Shares, ...]


def bound(job: Job) -> Bound:
    """Simulate a job and smooth what its follower saw.

    Raises:
        MecazenError: As of `run.run`.
    """
    check_version(job)
    scenario = load_scenario(job.scenario, job.settings)
    table = Table.of(simulate(scenario, job.row)[1])
    position, yaw = least_errors(*sights(scenario, table))
    return Bound(position, yaw)


def sights(scenario: Scenario, table: Table) -> tuple[list[Sight], Poses]:
    """Return what a run's follower saw, in odom, and where the person truly was then.

    The sensor is asked again: its noise comes from the seed. The true person is placed in
    odom by where the odometry believed the robot to be, as of `scores.score`.
    """
    sensor = Sensor(scenario.sensor, scenario.seed, scenario.sim.tick_s)
    spread = scenario.sensor.position_std_m, scenario.sensor.position_std_m
    noise = np.diag(np.square([*spread, math.radians(scenario.sensor.yaw_std_deg)]))
    robots, odoms, persons = (_rows(table.poses(who)) for who in ("robot", "odom", "target"))
    seen, ticks = [], []
    for tick, (robot, person) in enumerate(zip(robots, persons, strict=True)):
        frame = sensor.observe(tick, robot, person)
        if frame is not None and frame.pose is not None:
            base = odoms[frame.capture_tick]
            pose = base.compose(frame.pose) if scenario.sensor.frame == "base_link" else frame.pose
            covariance = noise
            if scenario.sensor.frame == "base_link":
                c, s = math.cos(base.yaw), math.sin(base.yaw)
                turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
                covariance = turn @ noise @ turn.T
            seen.append(Sight(frame.capture_tick * table.tick_s, pose, covariance))
            ticks.append(frame.capture_tick)
    at = table.where(np.array(ticks))
    return seen, at.poses("odom").compose(at.poses("robot").between(at.poses("target")))


def _rows(poses: Poses) -> list[Pose2D]:
    return [Pose2D(*row) for row in zip(*(axis.tolist() for axis in poses), strict=True)]


def shares(
    best: Series,
    oracle: Series,
    records: Mapping[Key, Record],
    bounds: Mapping[Key, Bound],
) -> Shares:
    """Return the shares in a case from its runs, the oracle's and their bounds."""

    def mean(series: Series, score: str) -> Interval:
        return mean_interval([getattr(records[job.key].scores.whole, score) for job in series.jobs])

    least = [bounds[job.key] for job in best.jobs]
    return Shares(
        name=best.row,
        d_err_m=mean(best, "d_err_m"),
        control_d_err_m=mean(oracle, "d_err_m"),
        theta_err_deg=mean(best, "theta_err_deg"),
        control_theta_err_deg=mean(oracle, "theta_err_deg"),
        filter_position_m=mean(best, "estimate_position_err_m"),
        smoother_position_m=mean_interval([one.position_m for one in least]),
        filter_yaw_deg=mean(best, "estimate_yaw_err_deg"),
        smoother_yaw_deg=mean_interval([one.yaw_deg for one in least]),
    )


def table(rows: Sequence[Shares]) -> Shown:
    """Return the rows as a table, each mean above its 95 % interval."""
    shown = Shown(show_lines=True, caption="means over the runs, below each its 95 % interval")
    shown.add_column("case", overflow="fold")
    for score in ("D_err \\[m]", "Θ_err \\[°]"):
        shown.add_column(score)
        shown.add_column("of it by\ncontrol")
    for estimate in ("position\\[m]", "yaw \\[°]"):
        shown.add_column(f"estimate\n{estimate}")
        shown.add_column("least by\nsmoothing")
    for row in rows:
        shown.add_row(
            row.name,
            show(row.d_err_m, 4),
            show(row.control_d_err_m, 4),
            show(row.theta_err_deg, 2),
            show(row.control_theta_err_deg, 2),
            show(row.filter_position_m, 4),
            show(row.smoother_position_m, 4),
            show(row.filter_yaw_deg, 2),
            show(row.smoother_yaw_deg, 2),
        )
    return shown
