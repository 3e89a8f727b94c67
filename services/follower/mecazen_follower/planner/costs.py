"""Costs of paths: deviations from the place beside the person, and proximity to obstacles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.drive import Array
from mecazen.portable import Floats

from mecazen_follower.planner.field import Field, Shadows
from mecazen_follower.planner.rollout import Rollout

FACTOR = 3.0
"""Ratio of a priority's weight to the weight of the next priority."""
DISTANCE_M = 0.5
"""Distance error that costs as much as not seeing the person, at equal weights [m]."""
NEAR, TOUCHING = 400.0, 1e5
"""Costs of being near an obstacle, and of touching it: higher than those of all priorities."""
JERKY = 0.4
"""Cost of a squared change of the velocities [m/s, rad/s] from one step to the next."""


class Sight(NamedTuple):
    """A camera's direction on the robot and half its field of view [rad], and its range [m]."""

    yaw: float = 0.0
    half_fov: float = math.pi
    max_range: float = math.inf


class Extents(NamedTuple):
    """Half the robot's length and width, and the radius of a person [m]."""

    length: float
    width: float
    person: float

    @property
    def disc(self) -> float:
        """The radius of the disc that encloses a quarter of the robot [m]."""
        return math.hypot(self.length, self.width) / 2


class Situation(NamedTuple):
    """Surroundings of the robot, relative to its position.

    `person` and `goals` (steps, 3) contain x, y and yaw. `movers` (steps, n, 2) and `standing` (n,
    2) contain positions.
    """

    person: Floats
    goals: Floats
    movers: Floats
    standing: Floats
    shadows: Shadows


class Costs:
    """Costs of paths, weighted by priority."""

    def __init__(
        self,
        priorities: Sequence[str],
        standoff: float,
        clearance: float,
        body: Extents,
        sight: Sight,
    ) -> None:
        self.weights = {name: FACTOR**-rank for rank, name in enumerate(priorities)}
        scale = FACTOR ** (len(priorities) - 1)
        self.weights = {name: scale * weight for name, weight in self.weights.items()}
        self._standoff, self._clearance = standoff, clearance
        self._body, self._sight = body, sight

    def of(self, ways: Rollout, scene: Situation) -> Array:
        """Return the mean cost per step of each path (n); weights rise from 0.5 to 1.5."""
        kind = ways.x.dtype
        person, goals = scene.person.astype(kind), scene.goals.astype(kind)
        x, y = ways.x - person[:, :1], ways.y - person[:, 1:2]
        distance = np.maximum(np.sqrt(x * x + y * y), kind.type(1e-6))
        weights = self.weights
        cost = weights["distance"] * _huber(np.abs(distance - self._standoff) / DISTANCE_M)
        reach = goals[:, :2] - person[:, :2]
        reach /= np.hypot(reach[:, :1], reach[:, 1:])
        along = (x * reach[:, :1] + y * reach[:, 1:]) / distance
        cost += weights["bearing"] * 2.0 * (1.0 - along)
        c, s = np.cos(goals[:, 2:]), np.sin(goals[:, 2:])
        cost += weights["heading"] * 2.0 * (1.0 - ways.c * c - ways.s * s)
        cost += weights["visibility"] * self.unseen(ways, scene, x, y, distance).astype(kind)
        cost += self._near(self.clearance(ways, scene))
        # at the standoff, the person does not count as an obstacle
        least = self._body.person + math.hypot(self._body.length, self._body.width)
        cost += self._near(distance - least, min(self._clearance, self._standoff - least))
        steps = np.linspace(0.5, 1.5, len(x), dtype=kind)[:, None]
        jerk = np.diff(ways.commands, axis=0)
        total: Array = (steps * cost).mean(axis=0) + JERKY * (jerk * jerk).sum(axis=(0, 1))
        return total

    def unseen(
        self, ways: Rollout, scene: Situation, x: Array, y: Array, distance: Array
    ) -> npt.NDArray[np.bool_]:
        """Return whether the person is unseen from positions relative to the person (steps, n)."""
        hidden = scene.shadows.hide(x, y, distance) | (distance > self._sight.max_range)
        if self._sight.half_fov < math.pi:
            c, s = math.cos(self._sight.yaw), math.sin(self._sight.yaw)
            ahead = -(x * (c * ways.c - s * ways.s) + y * (s * ways.c + c * ways.s)) / distance
            hidden |= ahead < math.cos(self._sight.half_fov)
        return hidden

    def clearance(self, ways: Rollout, scene: Situation) -> Array:
        """Return the distance from the robot to the nearest obstacle or walker (steps, n)."""
        least: Array = np.full_like(ways.x, np.inf)
        disc = self._body.disc
        low, high = np.array((ways.x.min(), ways.y.min())), np.array((ways.x.max(), ways.y.max()))
        field = Field(scene.standing, low - disc, high + disc)
        c, s = ways.c * (self._body.length / 2), ways.s * (self._body.length / 2)
        across_c, across_s = ways.c * (self._body.width / 2), ways.s * (self._body.width / 2)
        # four discs, each enclosing a quarter of the robot
        for dx, dy in ((c - across_s, s + across_c), (c + across_s, s - across_c)):
            np.minimum(least, field.distance(ways.x + dx, ways.y + dy), out=least)
            np.minimum(least, field.distance(ways.x - dx, ways.y - dy), out=least)
        least -= disc
        between = self._body.person + math.hypot(self._body.length, self._body.width)
        movers = scene.movers.astype(ways.x.dtype)
        square = np.full_like(ways.x, np.inf)
        for i in range(movers.shape[1]):
            x, y = ways.x - movers[:, i, :1], ways.y - movers[:, i, 1:]
            np.minimum(square, x * x + y * y, out=square)
        nearest: Array = np.minimum(least, np.sqrt(square) - between)
        return nearest

    def _near(self, gap: Array, wanted: float | None = None) -> Array:
        wanted = self._clearance if wanted is None else max(wanted, 1e-3)
        near = np.maximum(1.0 - gap / wanted, 0.0)
        cost: Array = NEAR * near * near + TOUCHING * (gap < 0.0).astype(gap.dtype)
        return cost


def _huber(error: Array) -> Array:
    square = np.minimum(error, 1.0)
    huber: Array = square * (2.0 * error - square)
    return huber
