"""The evaluation of paths: their costs, what blocks them, and what they give up."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.arrays import to_rectangle
from mecazen.config.follower import PlannerConfig
from mecazen.drive import Array
from mecazen.geometry import Standoff
from mecazen.portable import Floats

from mecazen_follower.planner.surroundings import DistanceField, Shadows
from mecazen_follower.sight import FieldOfView

FACTOR = 3.0
"""Ratio of a priority's weight to the weight of the next priority."""
DISTANCE_M = 0.5
"""Distance error that costs as much as not seeing the person, at equal weights [m]."""
NEAR, TOUCHING = 400.0, 1e5
"""Costs of being near an obstacle, and of touching it: higher than those of all priorities."""
JERKY = 0.4
"""Cost of a squared change of the velocities [m/s, rad/s] from one step to the next."""
GIVEN_UP_M, GIVEN_UP_RAD = 0.3, math.radians(30.0)
"""Errors of distance and angle at the end of a plan from which on they count as given up."""
STILL_M = 0.15
"""A robot that moves less than this in a whole plan is waiting [m]."""


class Extents(NamedTuple):
    """Half the robot's length and width, and the radius of a person [m]."""

    length: float
    width: float
    person: float

    @property
    def circle(self) -> float:
        """The distance of a person's middle from the robot's if they touch at a corner [m]."""
        return self.person + math.hypot(self.length, self.width)


class Situation(NamedTuple):
    """Person, obstacles and walkers ahead, relative to the robot's position, along odom's axes.

    `person` and `goals` (steps, 3) contain x, y and yaw; `walkers` (steps, n, 2) and `standing` (n,
    2) contain positions.
    """

    person: Floats
    goals: Floats
    walkers: Floats
    standing: Floats
    shadows: Shadows


class Rollout(NamedTuple):
    """Poses after each step, each (steps, n): x, y [m], cos and sin of the yaw.

    `commands` (steps, 3, n) are the velocities along odom's axes and yaw rates commanded.
    """

    x: Array
    y: Array
    c: Array
    s: Array
    commands: Array


class Plan(NamedTuple):
    """The plan: open, avoiding, gave_up_<priority>, searching or waiting; and its reason."""

    state: str
    reason: str = ""


OPEN = Plan("open")


class Costs:
    """Judges paths by the priorities of the configuration."""

    def __init__(
        self, config: PlannerConfig, standoff: Standoff, body: Extents, view: FieldOfView
    ) -> None:
        ranks = reversed(range(len(config.priorities)))
        self.weights = {
            name: FACTOR**rank for name, rank in zip(config.priorities, ranks, strict=True)
        }
        """The weight of each priority, the highest first."""
        self._clearance, self._standoff = config.clearance_m, standoff
        self._body, self._view = body, view

    def evaluate(self, paths: Rollout, situation: Situation) -> Array:
        """Return the mean cost per step of each path (n); weights rise from 0.5 to 1.5."""
        dtype = paths.x.dtype
        person, goals = situation.person.astype(dtype), situation.goals.astype(dtype)
        x, y = paths.x - person[:, :1], paths.y - person[:, 1:2]
        distance = np.maximum(np.sqrt(x * x + y * y), dtype.type(1e-6))
        weights, place = self.weights, self._standoff.distance
        cost = weights["distance"] * _huber(np.abs(distance - place) / DISTANCE_M)
        reach = goals[:, :2] - person[:, :2]
        reach /= np.hypot(reach[:, :1], reach[:, 1:])
        along = (x * reach[:, :1] + y * reach[:, 1:]) / distance
        cost += weights["bearing"] * 2.0 * (1.0 - along)
        c, s = np.cos(goals[:, 2:]), np.sin(goals[:, 2:])
        cost += weights["heading"] * 2.0 * (1.0 - paths.c * c - paths.s * s)
        cost += weights["visibility"] * self._unseen(paths, situation, x, y, distance).astype(dtype)
        cost += _proximity(self._clearances(paths, situation), self._clearance)
        # at the standoff, the person does not count as an obstacle
        least = self._body.circle
        cost += _proximity(distance - least, max(min(self._clearance, place - least), 1e-3))
        steps = np.linspace(0.5, 1.5, len(x), dtype=dtype)[:, None]
        jerk = np.diff(paths.commands, axis=0)
        total: Array = (steps * cost).mean(axis=0) + JERKY * (jerk * jerk).sum(axis=(0, 1))
        return total

    def blocked(self, path: Rollout, situation: Situation, dt: float, *, evades: bool) -> str:
        """Return what blocks a path (n = 1) or hides the person from it; "" if nothing does.

        Distances of points are from the robot's rectangle, those of walkers from its circumcircle.
        `dt` is the duration of a step [s]. A robot that `evades` returns late: it needs more
        clearance.
        """
        clearance = 1.5 * self._clearance if evades else self._clearance
        x, y, c, s, _ = path
        dx, dy = situation.standing[:, 0] - x, situation.standing[:, 1] - y
        half = self._body.length, self._body.width
        gaps = to_rectangle(c * dx + s * dy, c * dy - s * dx, half)
        gap = gaps.min(axis=1, initial=math.inf)
        walkers = situation.walkers
        passing = np.hypot(walkers[..., 0] - x, walkers[..., 1] - y) - self._body.circle
        crossing = passing.min(axis=1, initial=math.inf)
        off_x, off_y = x - situation.person[:, :1], y - situation.person[:, 1:2]
        hidden = situation.shadows.hide(off_x, off_y, np.hypot(off_x, off_y))[:, 0]
        for blocks, reason in (
            (gap < clearance, "an obstacle is in the way"),
            (crossing < clearance, "a walker crosses the path"),
            (hidden, "the person would be hidden"),
        ):
            if blocks.any():
                return f"{reason} in {dt * (int(np.argmax(blocks)) + 1):.1f} s"
        return ""

    def plan(self, path: Rollout, situation: Situation, obstacle: str, last: str) -> Plan:
        """Return the state of a path (n = 1) that was chosen because of an obstacle.

        For hysteresis, the state of the last plan remains until its error falls to half the limit.
        """
        x, y = path.x - situation.person[:, :1], path.y - situation.person[:, 1:2]
        distance = np.hypot(x, y)
        yaw, standoff = float(situation.person[-1, 2]), self._standoff
        bearing = math.atan2(float(y[-1, 0]), float(x[-1, 0])) - yaw - standoff.bearing
        heading = math.atan2(float(path.s[-1, 0]), float(path.c[-1, 0])) - yaw - standoff.heading
        error = abs(float(distance[-1, 0]) - standoff.distance)
        moved = math.hypot(float(path.x[-1, 0]), float(path.y[-1, 0]))
        if moved < STILL_M * (2 if last == "waiting" else 1) and error > GIVEN_UP_M:
            return Plan("waiting", obstacle)
        errors = {
            "distance": error / GIVEN_UP_M,
            "visibility": 2.0 * float(self._unseen(path, situation, x, y, distance).mean()),
            "bearing": abs(math.remainder(bearing, math.tau)) / GIVEN_UP_RAD,
            "heading": abs(math.remainder(heading, math.tau)) / GIVEN_UP_RAD,
        }
        for name in self.weights:  # highest priority first
            state = f"gave_up_{name}"
            if errors[name] > (0.5 if last == state else 1.0):
                return Plan(state, obstacle)
        return Plan("avoiding", obstacle)

    def _unseen(
        self, paths: Rollout, situation: Situation, x: Array, y: Array, distance: Array
    ) -> npt.NDArray[np.bool_]:
        """Return whether the person is unseen from positions relative to the person (steps, n)."""
        hidden = situation.shadows.hide(x, y, distance) | (distance > self._view.max_range)
        if self._view.half < math.pi:
            c, s = math.cos(self._view.centre), math.sin(self._view.centre)
            ahead = -(x * (c * paths.c - s * paths.s) + y * (s * paths.c + c * paths.s)) / distance
            hidden |= ahead < math.cos(self._view.half)
        return hidden

    def _clearances(self, paths: Rollout, situation: Situation) -> Array:
        """Return the distance from the robot to the nearest obstacle or walker (steps, n)."""
        x, y = paths.x, paths.y
        half_length, half_width = self._body.length / 2, self._body.width / 2
        # four discs, each enclosing a quarter of the robot
        disc = math.hypot(self._body.length, self._body.width) / 2
        low, high = np.array((x.min(), y.min())), np.array((x.max(), y.max()))
        field = DistanceField(situation.standing, low - disc, high + disc)
        c, s = paths.c * half_length, paths.s * half_length
        across_c, across_s = paths.c * half_width, paths.s * half_width
        least: Array = np.full_like(x, np.inf)
        for dx, dy in ((c - across_s, s + across_c), (c + across_s, s - across_c)):
            np.minimum(least, field.distance(x + dx, y + dy), out=least)
            np.minimum(least, field.distance(x - dx, y - dy), out=least)
        square = np.full_like(x, np.inf)
        for walker in situation.walkers.astype(x.dtype).swapaxes(0, 1):
            dx, dy = x - walker[:, :1], y - walker[:, 1:]
            np.minimum(square, dx * dx + dy * dy, out=square)
        nearest: Array = np.minimum(least - disc, np.sqrt(square) - self._body.circle)
        return nearest


def _proximity(gap: Array, clearance: float) -> Array:
    near = np.maximum(1.0 - gap / clearance, 0.0)
    cost: Array = NEAR * near * near + TOUCHING * (gap < 0.0).astype(gap.dtype)
    return cost


def _huber(error: Array) -> Array:
    square = np.minimum(error, 1.0)
    huber: Array = square * (2.0 * error - square)
    return huber
