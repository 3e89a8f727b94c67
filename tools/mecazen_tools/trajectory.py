"""The trajectory of a run, tick by tick, and its measures of following."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from itertools import chain, pairwise, product
from statistics import fmean
from typing import Any

import msgspec
import numpy as np
from mecazen import keys
from mecazen.arrays import to_rectangle
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.config.world import Box, Cylinder
from mecazen.errors import MecazenError
from mecazen.geometry import Pose2D, overlap
from mecazen.keys import Topic
from mecazen.messages import FollowerState, Message, Odometry, Twist, planar_covariance
from mecazen.programs import graph_of
from mecazen.robots import join_key
from mecazen.wire import Stamp

from mecazen_tools.table import Floats, Poses, Table, deviations, first_motion

Row = tuple[float | str | None, ...]

POSE = ("x_m", "y_m", "yaw_rad")
TWIST = ("vx_m_s", "vy_m_s", "yaw_rate_rad_s")
COVARIANCE = ("xx_m2", "xy_m2", "xyaw_m_rad", "yy_m2", "yyaw_m_rad", "yawyaw_rad2")
_ESTIMATE = (*POSE, *TWIST, *COVARIANCE)

LOST = ("lost", "searching")
"""The tracking states in which the robot no longer follows the prediction."""
NAMED_REASONS = 3

TOUCHING_M = 0.005
"""Gap below which bodies are in contact: the engine lets them sink in or bounce by less [m]."""


def _motion(odometry: Odometry) -> Row:
    return odometry.pose.pose.to_planar() + odometry.twist.twist.to_planar()


def _estimate(state: FollowerState) -> Row:
    if not state.estimate:
        return *(None,) * len(_ESTIMATE), state.tracking, state.reason
    person = state.estimate[0]
    (xx, xy, xw), (_, yy, yw), (_, _, ww) = planar_covariance(person.pose.covariance)
    return *_motion(person), xx, xy, xw, yy, yw, ww, state.tracking, state.reason


SOURCES: dict[Topic[Any], tuple[str, Callable[[Any], Row], list[str]]] = {
    keys.GROUND_TRUTH: ("physics", _motion, [f"robot_{name}" for name in (*POSE, *TWIST)]),
    keys.ODOM: ("controller", lambda m: m.pose.pose.to_planar(), [f"odom_{name}" for name in POSE]),
    keys.TARGET_ODOM: ("target", _motion, [f"target_{name}" for name in (*POSE, *TWIST)]),
    keys.FOLLOWER_STATE: (
        "follower",
        _estimate,
        [*(f"estimate_{name}" for name in _ESTIMATE), "tracking"],
    ),
    keys.CMD_VEL: ("follower", Twist.to_planar, [f"cmd_{name}" for name in TWIST]),
}
"""Service, values and columns of each topic. The follower's last value, its reason, has no column:
the hash of a run covers the columns."""
Columns = dict[tuple[str, Topic[Any]], dict[int, Row]]
"""The values of a topic of a robot by tick."""
COLUMNS = ("t_s", *chain.from_iterable(columns for _, _, columns in SOURCES.values()))
"""Poses of robot and target are true, in world; odom and estimate are in odom.

Twists are in the frame of the moving body. The covariance is of the estimated pose.
"""


class Scores(msgspec.Struct, frozen=True, omit_defaults=True):
    """The published measures of following; None without a person who moves.

    The errors are means over all ticks from the first motion of the person on.
    """

    d_err_m: float | None
    """Mean of |D - D0|, D the distance from robot to person."""
    theta_err_deg: float | None
    """Mean of |Θ - Θ0|, Θ the wrapped difference of the headings."""
    lost: dict[str, float] = {}
    """Share of time in which the person was lost, by reason."""


class Contacts(msgspec.Struct, frozen=True):
    """Numbers of contacts that begin between a robot and other bodies."""

    persons: int
    """With the persons whom robots follow."""
    obstacles: int


class Trajectory:
    """Collects the samples of a run from a bus into one row a tick.

    Args:
        bus: The bus on which the services publish.
        scenario: The scenario of the run; columns of services that it leaves out stay empty.
    """

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        self.scenario = scenario
        self._columns: Columns = {}
        self._required: dict[tuple[str, Topic[Any]], int] = {}
        """Ticks from one sample to the next, of the columns that make a row complete."""
        odom_rate = graph_of(scenario).rate(keys.ODOM.key)
        for robot, (topic, source) in product(scenario.names, SOURCES.items()):
            service, read, _ = source
            if service not in scenario.services:
                continue
            self._subscribe(bus, topic, robot, service, read)
            if topic is not keys.FOLLOWER_STATE:  # a user's follower may publish none
                rate = odom_rate if topic in (keys.ODOM, keys.CMD_VEL) else None
                self._required[robot, topic] = scenario.of(robot).ticks_per(rate)

    def _subscribe(
        self, bus: Bus, topic: Topic[Any], robot: str, service: str, read: Callable[[Any], Row]
    ) -> None:
        tick_ns = self.scenario.sim.tick_ns
        column = self._columns[robot, topic] = {}

        def take(message: Message, stamp: Stamp | None) -> None:
            if stamp is not None:
                column.setdefault(stamp.time_ns // tick_ns, read(message))

        publisher = join_key(service, robot)
        bus.subscribe(keys.of_robot(topic, robot), take, every=True, sender=publisher)

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns: `COLUMNS`, with several robots those of each robot."""
        time, *names = COLUMNS
        return time, *(join_key(name, robot) for robot in self.scenario.names for name in names)

    @property
    def complete(self) -> bool:
        """Whether all rows are complete."""
        return self.done >= self.scenario.sim.ticks

    @property
    def done(self) -> int:
        """Number of rows that have all required samples."""
        return len(self.ticks)

    @property
    def ticks(self) -> range:
        """The numbers of the rows' ticks."""
        rows = (len(self._columns[key]) * ticks for key, ticks in self._required.items())
        return range(min((self.scenario.sim.ticks, *rows)))

    def refuse_incomplete(self) -> None:
        """Raise MecazenError if rows are missing, as with a follower that publishes no commands."""
        if not self.complete:
            ticks = self.scenario.sim.ticks
            raise MecazenError(f"the run ended after {self.done} of {ticks} ticks")

    def reset(self) -> None:
        """Clear all rows for a new run."""
        for column in self._columns.values():
            column.clear()

    def rows(self) -> list[Row]:
        """Return the rows in the order of `columns`; None for missing values."""
        columns = [
            (self._columns.get((robot, topic), {}), (None,) * len(names))
            for robot in self.scenario.names
            for topic, (_, _, names) in SOURCES.items()
        ]
        return [
            (
                tick * self.scenario.sim.tick_ns / 1e9,
                *chain.from_iterable(
                    [column.get(tick, empty)[: len(empty)] for column, empty in columns]
                ),
            )
            for tick in self.ticks
        ]

    def lost(self, robot: str = "") -> dict[str, float]:
        """Return the share of time in which a robot had lost its person, by reason."""
        column = self._columns.get((robot or self.scenario.names[0], keys.FOLLOWER_STATE), {})
        return lost_shares(column[tick][-2:] for tick in self.ticks if tick in column)

    def csv(self) -> bytes:
        """Return the rows as CSV, each number with all its digits."""
        # JSON's format of numbers takes a tenth of the time of str
        rows = msgspec.json.encode(self.rows())[2:-2].replace(b"],[", b"\n")
        cells = rows.replace(b",null", b",").replace(b'"', b"")
        header = ",".join(self.columns).encode()
        return b"".join(line + b"\n" for line in (header, cells) if line)

    def to_numpy(self) -> Any:
        """Return the rows as a structured array: `trajectory.to_numpy()["robot_x_m"]`.

        Numbers are float64, NaN for missing values; `tracking` is text.
        """
        kinds = ["U16" if name.endswith("tracking") else "f8" for name in self.columns]
        empty = ["" if kind == "U16" else math.nan for kind in kinds]
        rows = [
            tuple(empty[n] if cell is None else cell for n, cell in enumerate(row))
            for row in self.rows()
        ]
        return np.array(rows, dtype=list(zip(self.columns, kinds, strict=True)))

    def to_pandas(self) -> Any:
        """Return the rows as a table, with `t_s` as its index; pandas must be installed."""
        import pandas as pd  # noqa: PLC0415  # optional, and slow

        return pd.DataFrame(self.to_numpy()).set_index("t_s")

    def sha256(self) -> str:
        """Return the hash of the CSV; equal hashes mean that all numbers are equal."""
        return hashlib.sha256(self.csv()).hexdigest()

    def table(self, robot: str = "") -> Table:
        """Return the rows of a robot as columns, by default of the first of several."""
        robot, rows = robot or self.scenario.names[0], self.to_numpy()
        names = {name: name if name == "t_s" else join_key(name, robot) for name in COLUMNS}
        columns = {name: np.ascontiguousarray(rows[key]) for name, key in names.items()}
        t = columns["t_s"]
        return Table(columns, float(t[1] - t[0]) if len(t) > 1 else math.nan)

    def scores(self, robot: str = "") -> Scores:
        """Return the published measures so far of a robot, by default the first of several."""
        robot = robot or self.scenario.names[0]
        table = self.table(robot).having("target_x_m").having("robot_x_m")
        lost, first = self.lost(robot), first_motion(table)
        if first is None:
            return Scores(d_err_m=None, theta_err_deg=None, lost=lost)
        standoff = self.scenario.of(robot).follower.standoff
        distance, _, yaw = abs(deviations(table.where(slice(first, None)), standoff)).tolist()
        return Scores(fmean(distance), math.degrees(fmean(yaw)), lost)

    def contacts(self, robot: str = "") -> Contacts:
        """Return the contacts so far of a robot, by default the first of several."""
        robot = robot or self.scenario.names[0]
        part, world = self.scenario.of(robot), self.scenario.world
        length, width = (half + TOUCHING_M for half in part.robot.footprint)
        table = self.table(robot)
        known = ~np.isnan(table["robot_x_m"])
        robots = table.where(known).poses("robot")
        poses = [robots.at(row) for row in range(len(robots.x))]

        def touches(x: Floats | float, y: Floats | float, radius: float) -> list[bool]:
            centre = robots.between(Poses(np.asarray(x), np.asarray(y), np.zeros(())))
            gaps_m = to_rectangle(centre.x, centre.y, (length, width)).tolist()
            return [gap_m <= radius for gap_m in gaps_m]

        def hits(solid: Box | Cylinder) -> list[bool]:
            if not isinstance(solid, Box):
                return touches(*solid.position_m, solid.size_m[0])
            box = Pose2D(*solid.position_m, math.radians(solid.yaw_deg))
            half = solid.size_m[0] / 2, solid.size_m[1] / 2
            return [overlap(pose, (length, width), box, half) for pose in poses]

        def is_near(solid: Box | Cylinder) -> bool:
            if isinstance(solid, Box) and solid.bottom_m >= part.robot.height:
                return False
            x, y = solid.position_m
            reach = math.hypot(length, width) + math.hypot(*solid.size_m[:2])
            return bool((np.hypot(robots.x - x, robots.y - y) < reach).any())

        followed = [self.table(name).where(known) for name in self.scenario.names]
        persons = sum(
            _begins(touches(table["target_x_m"], table["target_y_m"], world.person.radius_m))
            for table in followed
        )
        near = filter(is_near, world.solids)  # a map has thousands
        return Contacts(persons, sum(_begins(hits(solid)) for solid in near))


def lost_shares(states: Iterable[Row]) -> dict[str, float]:
    """Return the share of tracking states, each with its reason, that are lost, by reason."""
    reasons = [str(reason) if state in LOST else None for state, reason in states]
    counts = Counter(reason for reason in reasons if reason is not None)
    return {reason: count / len(reasons) for reason, count in counts.most_common()}


def sentence(shares: Mapping[str, float]) -> str:
    """Return how long a person was lost and why, from `lost_shares`; empty if never."""
    if not shares:
        return ""
    parts = [f"{reason} {share:.0%}" for reason, share in [*shares.items()][:NAMED_REASONS]]
    reasons = ", ".join(parts) if len(shares) > 1 else next(iter(shares))
    return f"lost {sum(shares.values()):.0%} of the time: {reasons}"


def _begins(touching: Iterable[bool]) -> int:
    """Return how often a contact begins."""
    return sum(now and not before for before, now in pairwise((False, *touching)))
