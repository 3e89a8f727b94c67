"""The trajectory of a run, tick by tick, and its measures of following."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import chain, dropwhile, pairwise
from types import MappingProxyType
from typing import Any, cast

import msgspec
import numpy as np
from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D, Standoff, overlap, to_rectangle, wrap
from mecazen.messages import FollowerState, Message, Odometry, Twist, planar_covariance
from mecazen.robots import join_key
from mecazen.wire import Stamp

POSE = ("x_m", "y_m", "yaw_rad")
TWIST = ("vx_m_s", "vy_m_s", "yaw_rate_rad_s")
COVARIANCE = ("xx_m2", "xy_m2", "xyaw_m_rad", "yy_m2", "yyaw_m_rad", "yawyaw_rad2")
_ESTIMATE = (*POSE, *TWIST, *COVARIANCE)
_COLUMNS = {
    keys.GROUND_TRUTH.key: [f"robot_{what}" for what in (*POSE, *TWIST)],
    keys.ODOM.key: [f"odom_{what}" for what in POSE],
    keys.TARGET_ODOM.key: [f"target_{what}" for what in (*POSE, *TWIST)],
    keys.FOLLOWER_STATE.key: [*(f"estimate_{what}" for what in _ESTIMATE), "tracking"],
    keys.CMD_VEL.key: [f"cmd_{what}" for what in TWIST],
}
COLUMNS = ("t_s", *chain.from_iterable(_COLUMNS.values()))
"""Poses of robot and target are true, in world; odom and estimate are in odom.

Twists are in the frame of the moving body. The covariance is of the estimated pose.
"""

TOUCHING_M = 0.005
"""Gap below which bodies are in contact: the engine lets them sink in or bounce by less [m]."""

Row = tuple[float | str | None, ...]


class Scores(msgspec.Struct, frozen=True):
    """The published measures of following; None without a person who moves.

    The measures are means over all ticks from the first motion of the person on.
    """

    d_err_m: float | None
    """Mean of |D - D0|, D the distance from robot to person."""
    theta_err_deg: float | None
    """Mean of |Θ - Θ0|, Θ the wrapped difference of the headings."""


class Contacts(msgspec.Struct, frozen=True):
    """Numbers of contacts that begin between a robot and other bodies."""

    persons: int
    """With the persons whom robots follow."""
    obstacles: int


class Trajectory:
    """Collects the samples of a run from a bus into one row a tick.

    Args:
        bus: The bus on which the services publish.
        tick_ns: The control period [ns].
        ticks: The number of rows of a whole run.
        services: Services of the run; columns of other services stay empty.
        ticks_per_odom: Ticks from one odometry sample to the next, by robot name; a command answers
            each of these samples. Each robot has its own namespace.
    """

    def __init__(
        self,
        bus: Bus,
        tick_ns: int,
        ticks: int,
        services: Sequence[str],
        ticks_per_odom: Mapping[str, int] = MappingProxyType({"": 1}),
    ) -> None:
        self._tick_ns = tick_ns
        self._ticks = ticks
        self._robots = tuple(ticks_per_odom)
        self._columns: dict[tuple[str, str], dict[int, Row]] = {}
        self._needed: dict[tuple[str, str], int] = {}
        for robot, every in ticks_per_odom.items():
            follow = partial(self._follow, bus, robot)
            follow("physics", keys.GROUND_TRUTH, _motion)
            if "controller" in services:
                follow("controller", keys.ODOM, _pose, every)
            if "target" in services:
                follow("target", keys.TARGET_ODOM, _motion)
            if "follower" in services:
                # a user's follower may publish no state; ours publishes it before the command
                follow("follower", keys.FOLLOWER_STATE, _estimate, None)
                follow("follower", keys.CMD_VEL, Twist.to_planar, every)

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns: `COLUMNS`, with several robots those of each robot."""
        time, *others = COLUMNS
        return time, *(join_key(name, robot) for robot in self._robots for name in others)

    @property
    def complete(self) -> bool:
        """Whether all rows are complete."""
        return self.done >= self._ticks

    @property
    def done(self) -> int:
        """Number of rows that have all required samples."""
        rows = (len(self._columns[key]) * every for key, every in self._needed.items())
        return min(self._ticks, *rows)

    def reset(self) -> None:
        """Clear all rows for a new run."""
        for column in self._columns.values():
            column.clear()

    def rows(self) -> list[Row]:
        """Return the rows in the order of `columns`; None for missing values."""
        columns = [
            (self._columns.get((robot, key), {}), (None,) * len(names))
            for robot in self._robots
            for key, names in _COLUMNS.items()
        ]
        return [
            (
                tick * self._tick_ns / 1e9,
                *chain.from_iterable([column.get(tick, empty) for column, empty in columns]),
            )
            for tick in range(self.done)
        ]

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
        import numpy as np  # noqa: PLC0415 - a command needs none

        kinds = ["U16" if name.endswith("tracking") else "f8" for name in self.columns]
        empty = ["" if kind == "U16" else math.nan for kind in kinds]
        rows = [
            tuple(empty[n] if cell is None else cell for n, cell in enumerate(row))
            for row in self.rows()
        ]
        return np.array(rows, dtype=list(zip(self.columns, kinds, strict=True)))

    def to_pandas(self) -> Any:
        """Return the rows as a table, with `t_s` as its index; pandas must be installed."""
        import pandas as pd  # noqa: PLC0415 - as above

        return pd.DataFrame(self.to_numpy()).set_index("t_s")

    def sha256(self) -> str:
        """Return the hash of the CSV; equal hashes mean that all numbers are equal."""
        return hashlib.sha256(self.csv()).hexdigest()

    def scores(self, standoff: Standoff, robot: str = "") -> Scores:
        """Return the measures of a robot with this standoff."""
        robots = self._columns[robot, keys.GROUND_TRUTH.key]
        persons = self._columns.get((robot, keys.TARGET_ODOM.key), {})
        pairs = [
            (_planar(robots[tick]), _planar(persons[tick]))
            for tick in range(self.done)
            if tick in persons
        ]
        pairs = list(dropwhile(lambda pair: pair[1] == pairs[0][1], pairs))
        if not pairs:
            return Scores(d_err_m=None, theta_err_deg=None)
        distances = math.fsum(abs(r.distance(p) - standoff.distance) for r, p in pairs)
        headings = math.fsum(abs(wrap(r.yaw - p.yaw - standoff.heading)) for r, p in pairs)
        return Scores(distances / len(pairs), math.degrees(headings / len(pairs)))

    def contacts(self, scenario: Scenario, robot: str = "") -> Contacts:
        """Return the contacts of a robot; `scenario` is the whole scenario."""
        part, world = scenario.of(robot), scenario.world
        length, width = (half + TOUCHING_M for half in part.robot.footprint)
        height = part.robot.height

        def touches(pose: Pose2D, x: float, y: float, radius: float) -> bool:
            at = pose.between(Pose2D(x, y))
            return to_rectangle(at.x, at.y, (length, width)) <= radius

        def hits(pose: Pose2D, solid: Box | Cylinder) -> bool:
            x, y = solid.position_m
            if not isinstance(solid, Box):
                return touches(pose, x, y, solid.size_m[0])
            half = solid.size_m[0] / 2, solid.size_m[1] / 2
            middle = Pose2D(x, y, math.radians(solid.yaw_deg))
            return overlap(pose, (length, width), middle, half)

        rows = self._columns[robot, keys.GROUND_TRUTH.key]
        poses = [_planar(rows[tick]) for tick in range(self.done)]
        path = np.array([pose[:2] for pose in poses]).reshape(-1, 2)

        def is_near(solid: Box | Cylinder) -> bool:
            if isinstance(solid, Box) and solid.bottom_m >= height:
                return False
            reach = math.hypot(length, width) + math.hypot(*solid.size_m[:2])
            return bool((np.hypot(*(path - solid.position_m).T) < reach).any())

        persons = 0
        for name in self._robots:
            at = self._columns.get((name, keys.TARGET_ODOM.key), {})
            radius = world.person.radius_m
            persons += _begins(
                tick in at and touches(pose, *_planar(at[tick])[:2], radius)
                for tick, pose in enumerate(poses)
            )
        near = filter(is_near, world.solids)  # a map has thousands
        obstacles = sum(_begins(hits(pose, solid) for pose in poses) for solid in near)
        return Contacts(persons, obstacles)

    def _follow(
        self,
        bus: Bus,
        robot: str,
        service: str,
        topic: keys.Topic[Any],
        read: Callable[[Any], Row],
        every: int | None = 1,
    ) -> None:
        tick_ns = self._tick_ns
        column = self._columns.setdefault((robot, topic.key), {})
        if every is not None:
            self._needed[robot, topic.key] = every

        def take(message: Message, stamp: Stamp | None) -> None:
            if stamp is not None:
                column.setdefault(stamp.time_ns // tick_ns, read(message))

        of = join_key(service, robot)
        bus.subscribe(keys.of_robot(topic, robot), take, every=True, of=of)


def _begins(touching: Iterable[bool]) -> int:
    """Return how often a contact begins."""
    return sum(now and not before for before, now in pairwise((False, *touching)))


def _planar(row: Row) -> Pose2D:
    return Pose2D(*cast(Pose2D, row[:3]))


def _pose(odometry: Odometry) -> Row:
    return odometry.pose.pose.to_planar()


def _motion(odometry: Odometry) -> Row:
    return odometry.pose.pose.to_planar() + odometry.twist.twist.to_planar()


def _estimate(state: FollowerState) -> Row:
    if not state.estimate:
        return *(None,) * len(_ESTIMATE), state.tracking
    person = state.estimate[0]
    (xx, xy, xw), (_, yy, yw), (_, _, ww) = planar_covariance(person.pose.covariance)
    return *_motion(person), xx, xy, xw, yy, yw, ww, state.tracking
