"""Walkers who plan a way round obstacles and give way by ORCA or by social forces.

They choose velocities one after the other, so each walker uses the new places of the walkers
before. A walker changes its velocity at once, and brakes when it touches something.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D

from mecazen_experiments.followbench.episodes import Manners
from mecazen_experiments.followbench.pedestrians import SPEED_M_S, STEP_S, orca, social
from mecazen_experiments.followbench.pedestrians.grid import Grid
from mecazen_experiments.followbench.pedestrians.walls import Walls

SKIN_M = 0.1
"""Margin that ORCA adds to a body's radius."""
GROWN_M = 0.05
"""Margin of a body; if the body with this margin touches something, the walker brakes ..."""
BRAKED = 1.0 / 20.0
"""... to this share of the velocity, after a step at rest."""
SLOW_M, ARRIVED_M = 1.0, 0.1
"""Distances of a way-point below which the walker slows down, and stands."""


class Outline(NamedTuple):
    """A rectangle about a place: extent ahead, behind and to each side [m]; heading [rad]."""

    ahead: float
    behind: float
    side: float
    yaw: float

    def gap(self, dx: float, dy: float) -> float:
        """Return the distance of a point from the outline; `dx` and `dy` are from the place [m]."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        along, across = c * dx + s * dy, abs(c * dy - s * dx)
        over = max(along - self.ahead, -self.behind - along, 0.0)
        beside = max(across - self.side, 0.0)
        return math.sqrt(over * over + beside * beside)


class Other(NamedTuple):
    """Another person or thing that moves: a disc, or a disc with an outline."""

    x: float
    y: float
    vx: float
    vy: float
    radius: float
    outline: Outline | None = None
    is_heeded: bool = True
    """Whether people give way to this; otherwise they only brake when they touch it."""

    def gap(self, x: float, y: float) -> float:
        """Return the distance of a place from the outline, or else from the disc [m]."""
        dx, dy = x - self.x, y - self.y
        if self.outline is not None:
            return self.outline.gap(dx, dy)
        return math.sqrt(dx * dx + dy * dy) - self.radius


class Errand(NamedTuple):
    """The goals of a walker."""

    start: Pose2D
    goals: tuple[tuple[float, float], ...]
    """Goals, in this order."""
    endless: bool = False
    """Whether the first goal follows again after the last."""
    speed: float = SPEED_M_S
    start_after: float = 0.0
    safe: float = 0.5
    """Distance to be kept from others beyond the walker's own body [m]."""
    plans: bool = True
    """Whether the way leads round obstacles."""
    within: float = 2.0
    """Distance at which a way-point is reached [m]."""


class Walkers:
    """Walkers on ways of the grid, step by step.

    Args:
        errands: The goals of each walker.
        obstacles: The obstacles of the world.
        radius: Radius of each body [m].
        manners: How the walkers give way.
        grid: The grid on which ways are planned.
    """

    def __init__(
        self,
        errands: Sequence[Errand],
        obstacles: Sequence[Box | Cylinder],
        radius: float,
        manners: Manners,
        grid: Grid,
    ) -> None:
        self._errands, self._radius, self._manners, self._grid = errands, radius, manners, grid
        self._walls = Walls(obstacles)
        self.states = [(one.start.x, one.start.y, 0.0, 0.0) for one in errands]
        """Place and velocity of each walker [m, m/s]."""
        self._ways = [self._way(one, one.start[:2]) for one in errands]
        self._next = [0] * len(errands)
        self._braking = [False] * len(errands)
        self._since = STEP_S

    def step(self, time: float, dt: float, others: Sequence[Other]) -> None:
        """Advance to a time by `dt` [s] among others."""
        self._since += dt
        chooses = self._since > STEP_S - 1e-9
        for n, (last_x, last_y, vx, vy) in enumerate(self.states):
            if chooses:
                vx, vy = self._choice(n, time, others)  # noqa: PLW2901
            x, y = last_x + dt * vx, last_y + dt * vy
            self.states[n] = x, y, vx, vy
            self._advance(n, x, y)
        if chooses:
            self._since = 0.0

    def _way(self, errand: Errand, start: tuple[float, float]) -> list[tuple[float, float]]:
        places = [start, *errand.goals]
        return self._grid.way(places) if errand.plans else list(errand.goals)

    def _advance(self, n: int, x: float, y: float) -> None:
        """Go on to the next way-point once this one is reached; the last one is kept."""
        way, errand = self._ways[n], self._errands[n]
        gx, gy = way[self._next[n]]
        if math.hypot(gx - x, gy - y) >= errand.within:
            return
        if self._next[n] + 1 < len(way):
            self._next[n] += 1
        elif errand.endless:
            self._ways[n], self._next[n] = self._way(errand, (x, y)), 0

    def _choice(self, n: int, time: float, others: Sequence[Other]) -> tuple[float, float]:
        """Return the velocity that a walker chooses [m/s]."""
        errand, goal = self._errands[n], self._ways[n][self._next[n]]
        if time < errand.start_after:
            return 0.0, 0.0
        x, y, vx, vy = self.states[n]
        walkers = (*self.states[:n], *self.states[n + 1 :])
        everybody = (*walkers, *(other[:4] for other in others if other.is_heeded))
        wall = self._walls.nearest(x, y)
        if self._manners == "sfm":
            vx, vy = social.velocity(
                (x, y), (vx, vy), goal, everybody, wall, errand.safe, errand.speed
            )
        else:
            vx, vy = orca.velocity(
                (x, y),
                (vx, vy),
                _towards(x, y, goal, errand.speed),
                everybody,
                self._grid.near(x, y),
                self._radius + SKIN_M + errand.safe,
                errand.speed,
            )
        touches = wall[2] <= self._radius + GROWN_M or self._touches(x, y, walkers, others)
        stands, self._braking[n] = touches and not self._braking[n], touches
        if not touches:
            return vx, vy
        return (0.0, 0.0) if stands else (BRAKED * vx, BRAKED * vy)

    def _touches(
        self,
        x: float,
        y: float,
        walkers: Sequence[tuple[float, float, float, float]],
        others: Sequence[Other],
    ) -> bool:
        """Return whether a walker's grown body touches another walker or one of the others."""
        reach = self._radius + GROWN_M
        squared = (reach + self._radius) ** 2
        for px, py, _, _ in walkers:
            if (px - x) * (px - x) + (py - y) * (py - y) <= squared:
                return True
        return any(other.gap(x, y) <= reach for other in others)


def _towards(x: float, y: float, goal: tuple[float, float], speed: float) -> tuple[float, float]:
    """Return the velocity to a way-point [m/s]."""
    dx, dy = goal[0] - x, goal[1] - y
    distance = math.hypot(dx, dy)
    if distance < ARRIVED_M:
        return 0.0, 0.0
    part = speed * min(distance / SLOW_M, 1.0) / distance
    return part * dx, part * dy
