"""Walkers who give way to each other, to all other people, to robots and to obstacles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from mecazen.config.people import Reactive
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D
from mecazen.portable import Floats
from numpy.random import PCG64, Generator

from mecazen_people.manners import forces
from mecazen_people.manners.walking import Errand, Other, walked
from mecazen_people.motion import Motion

ARRIVED_M = 0.3
"""Distance within which a goal counts as reached [m]."""
CLEAR_M = 0.8
"""Minimum distance of a start from all people and things [m]."""
SPEED_STD_M_S = 0.26
"""Standard deviation of the preferred speeds [m/s], of Weidmann as `Reactive.speed_m_s`."""
DRAWS = 200
"""Number of start places tried for a walker, since an area may be full."""


def drawn(
    config: Reactive,
    seed: int,
    taken: Sequence[tuple[float, float]],
    obstacles: Sequence[Box | Cylinder],
) -> list[Errand]:
    """Return random errands: back and forth between two edges of an area, drawn independently.

    Each walker starts on the way, clear of the places that are `taken` [m], of other walkers and of
    obstacles, if there is room.
    """
    errands: list[Errand] = []
    here = list(taken)
    for number in range(config.count):
        random = Generator(PCG64([seed, number]))
        speed = config.speed_m_s + SPEED_STD_M_S * float(random.standard_normal())
        for _ in range(DRAWS):
            axis, way = random.random(2).tolist()
            one, other, part = random.random(3).tolist()
            edges = [config.x_m, config.y_m]
            along, across = edges if axis < 0.5 else edges[::-1]
            ends = [
                (end, across[0] + share * (across[1] - across[0]))
                for end, share in zip(along, (one, other), strict=True)
            ]
            ends = ends if axis < 0.5 else [(y, x) for x, y in ends]
            begin, goal = ends if way < 0.5 else ends[::-1]
            x, y = (a + part * (b - a) for a, b in zip(begin, goal, strict=True))
            if _is_clear((x, y), here, obstacles):
                break
        here.append((x, y))
        yaw = math.atan2(goal[1] - y, goal[0] - x)
        errands.append(Errand(Pose2D(x, y, yaw), (goal, begin), True, max(speed, 0.3)))
    return errands


def _is_clear(
    place: tuple[float, float],
    taken: Sequence[tuple[float, float]],
    obstacles: Sequence[Box | Cylinder],
) -> bool:
    point = np.array([place])
    return all(math.dist(place, one) >= CLEAR_M for one in taken) and all(
        forces.nearest(point, thing)[1][0] >= CLEAR_M for thing in obstacles
    )


class Pedestrians:
    """Reactive walkers, step by step.

    Each walker has independent fluctuations: a further walker does not change those of the others.

    Args:
        errands: The goals of each walker.
        obstacles: The obstacles of the world.
        radius: Radius of each body [m].
        seed: Seed of the fluctuations.
    """

    def __init__(
        self,
        errands: Sequence[Errand],
        obstacles: Sequence[Box | Cylinder],
        radius: float,
        seed: int,
    ) -> None:
        self._errands, self._obstacles, self._radius = errands, obstacles, radius
        self._places: Floats = np.array([one.start[:2] for one in errands]).reshape(-1, 2)
        self._velocities: Floats = np.zeros_like(self._places)
        self._fastest = np.array([forces.FASTEST * one.speed for one in errands])
        self._next = [0] * len(errands)
        self._random = [Generator(PCG64([seed, n, 1])) for n in range(len(errands))]
        self.motions = [Motion(one.start) for one in errands]
        """Current motion of each walker."""

    def step(self, time: float, dt: float, others: Sequence[Other]) -> None:
        """Advance to a time by `dt` [s] among others."""
        if not self._errands:
            return
        others = [one for one in others if one.is_heeded]
        preferred = np.array([self._preferred(n, time) for n in range(len(self._errands))])
        heading = forces.limited(preferred * 1e3, 1.0)
        around = np.array([one[:4] for one in others]).reshape(-1, 4)
        touching = np.full((len(self._errands), len(self._errands) + len(others)), 0.0)
        touching += 2.0 * self._radius
        touching[:, len(self._errands) :] = [self._radius + one.radius for one in others]
        np.fill_diagonal(touching, math.inf)
        force: Floats = (preferred - self._velocities) / forces.RELAXATION_S
        force += forces.repulsion(
            self._places,
            heading,
            np.concatenate((self._places, around[:, :2])),
            np.concatenate((self._velocities, around[:, 2:])),
            touching,
        ).sum(axis=1)
        force += forces.from_obstacles(self._places, self._obstacles)
        chance = np.array([random.standard_normal(2) for random in self._random])
        force = forces.limited(force, forces.STRONGEST_M_S2) + forces.FLUCTUATION_M_S2 * chance
        self._velocities = forces.limited(self._velocities + force * dt, self._fastest)
        self._places = self._places + self._velocities * dt
        rows = zip(self._places.tolist(), self._velocities.tolist(), strict=True)
        self.motions = [
            walked(last, place, v, dt) for last, (place, v) in zip(self.motions, rows, strict=True)
        ]

    def _preferred(self, number: int, time: float) -> tuple[float, float]:
        """Return the preferred velocity of a walker [m/s]."""
        errand = self._errands[number]
        if time < errand.start_after:
            return 0.0, 0.0
        x, y = self._places[number].tolist()
        gx, gy = errand.goals[self._next[number]]
        distance = math.hypot(gx - x, gy - y)
        if distance < ARRIVED_M:
            last = self._next[number] == len(errand.goals) - 1
            if last and not errand.endless:
                return 0.0, 0.0
            self._next[number] = 0 if last else self._next[number] + 1
        return errand.speed * (gx - x) / max(distance, 1e-9), errand.speed * (gy - y) / max(
            distance, 1e-9
        )
