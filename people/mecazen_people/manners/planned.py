"""Walkers who plan a way round obstacles and give way by ORCA or by social forces.

They are the pedestrians of Follow-Bench 1.0. They choose velocities one after the other, so each
walker uses the new places of the walkers before. A walker who touches something brakes. In
Follow-Bench a pedestrian changes its velocity at once; here the acceleration is limited.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from mecazen.config.world import Box, Cylinder

from mecazen_people.manners import orca, social
from mecazen_people.manners.grid import Grid
from mecazen_people.manners.walking import STEP_S, Errand, Other, walked
from mecazen_people.manners.walls import Walls
from mecazen_people.motion import Motion

SKIN_M = 0.1
"""Margin that ORCA adds to a body's radius."""
GROWN_M = 0.05
"""Margin of a body; if the body with this margin touches something, the walker brakes ..."""
BRAKED = 1.0 / 20.0
"""... to this share of the velocity, after a step at rest."""
SLOW_M, ARRIVED_M = 1.0, 0.1
"""Distances of a way-point below which the walker slows down, and stands."""

Manners = Literal["orca", "sfm"]


class Planned:
    """Walkers on ways of the grid, step by step.

    Args:
        errands: The goals of each walker.
        obstacles: The obstacles of the world.
        radius: Radius of each body [m].
        manners: How the walkers give way.
        grid: The grid on which ways are planned.
        acceleration: Largest acceleration of a walker [m/s²].
    """

    def __init__(
        self,
        errands: Sequence[Errand],
        obstacles: Sequence[Box | Cylinder],
        radius: float,
        manners: Manners,
        grid: Grid,
        acceleration: float = math.inf,
    ) -> None:
        self._acceleration = acceleration
        self._errands, self._radius, self._manners, self._grid = errands, radius, manners, grid
        self._walls = Walls(obstacles)
        self.states = [(one.start.x, one.start.y, 0.0, 0.0) for one in errands]
        """Place and velocity of each walker [m, m/s]."""
        self._ways = [self._way(one, one.start[:2]) for one in errands]
        self._next = [0] * len(errands)
        self._braking = [False] * len(errands)
        self._chosen = [(0.0, 0.0)] * len(errands)
        self._since = STEP_S
        self.motions = [Motion(one.start) for one in errands]

    def step(self, time: float, dt: float, others: Sequence[Other]) -> None:
        """Advance to a time by `dt` [s] among others."""
        self._since += dt
        chooses = self._since > STEP_S - 1e-9
        for n, (last_x, last_y, *now) in enumerate(self.states):
            if chooses:
                self._chosen[n] = self._choice(n, time, others)
            vx, vy = _approach(now, self._chosen[n], self._acceleration * dt)
            x, y = last_x + dt * vx, last_y + dt * vy
            self.states[n] = x, y, vx, vy
            self._advance(n, x, y)
            self.motions[n] = walked(self.motions[n], (x, y), (vx, vy), dt)
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


def _approach(
    now: Sequence[float], chosen: tuple[float, float], most: float
) -> tuple[float, float]:
    """Return the velocity nearest to the chosen one that differs from `now` by at most `most`."""
    dx, dy = chosen[0] - now[0], chosen[1] - now[1]
    change = math.sqrt(dx * dx + dy * dy)
    if change <= most:
        return chosen
    return now[0] + most / change * dx, now[1] + most / change * dy


def _towards(x: float, y: float, goal: tuple[float, float], speed: float) -> tuple[float, float]:
    """Return the velocity to a way-point [m/s]."""
    dx, dy = goal[0] - x, goal[1] - y
    distance = math.hypot(dx, dy)
    if distance < ARRIVED_M:
        return 0.0, 0.0
    part = speed * min(distance / SLOW_M, 1.0) / distance
    return part * dx, part * dy
