"""People on errands, who give way to each other, to all other people, to robots and to obstacles.

The forces are those of Helbing & Molnár: see `forces`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mecazen.config.people import Goal, Reactive
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D, Twist2D, rotate, wrap
from mecazen.portable import Floats
from numpy.random import PCG64, Generator

from mecazen_people import forces
from mecazen_people.motion import PersonMotion
from mecazen_people.paths import start_pose
from mecazen_people.recorded import MAX_YAW_RATE, STANDING_M_S

ARRIVED_M = 0.3
"""Distance within which a goal counts as reached [m]."""
CLEAR_M = 0.8
"""Minimum distance of a start from all people and things [m]."""
SPEED_STD_M_S = 0.26
"""Standard deviation of the preferred speeds [m/s], of Weidmann as `Reactive.speed_m_s`."""
SLOWEST_M_S = 0.3
"""Least preferred speed."""
DRAWS = 200
"""Number of start places tried for a walker, since an area may be full."""
TURN_HZ = 5.0
"""Gain with which a body turns to its direction of travel."""


class Agent(NamedTuple):
    """Another person or a robot, as a disc: place [m], velocity [m/s] and radius [m]."""

    x: float
    y: float
    vx: float
    vy: float
    radius: float


class Errand(NamedTuple):
    """The goals of a walker."""

    start: Pose2D
    goals: tuple[tuple[float, float], ...]
    endless: bool
    """Whether the first goal follows again after the last."""
    speed: float
    """Preferred speed [m/s]."""
    start_after: float = 0.0
    """Time before the walker sets off [s]."""


def agent_at(pose: Pose2D, twist: Twist2D, radius: float) -> Agent:
    """Return a person or a robot at a pose in the world; the twist is in the frame of the pose."""
    return Agent(pose.x, pose.y, *rotate(twist.x, twist.y, pose.yaw), radius)


def errand_of(path: Goal) -> Errand:
    """Return the errand of a configured path."""
    goals = (*path.via_m, path.goal_m)
    if path.back_and_forth:
        goals = (*goals, *path.via_m[::-1], (path.x_m, path.y_m))
    start_after_s = path.start_after_s
    return Errand(start_pose(path), goals, path.back_and_forth, path.speed_m_s, start_after_s)


def random_errands(
    config: Reactive,
    seed: int,
    occupied: Sequence[tuple[float, float]],
    obstacles: Sequence[Box | Cylinder],
) -> list[Errand]:
    """Return random errands: back and forth between two edges of an area, drawn independently.

    Each walker starts on the way, clear of the places that are `occupied` [m], of other walkers and
    of obstacles, if there is room.
    """
    errands: list[Errand] = []
    occupied, shapes = list(occupied), forces.shapes_of(obstacles)
    for number in range(config.count):
        random = Generator(PCG64([seed, number]))
        speed = config.speed_m_s + SPEED_STD_M_S * float(random.standard_normal())
        for _ in range(DRAWS):
            start, goal, share = _random_way(config, random)
            (x, y), (to_x, to_y) = start, goal
            place = x + share * (to_x - x), y + share * (to_y - y)
            gaps = forces.nearest(np.array([place]), shapes)[1].tolist()
            gaps += [math.dist(place, neighbour) for neighbour in occupied]
            if min(gaps, default=math.inf) >= CLEAR_M:
                break
        occupied.append(place)
        yaw = math.atan2(goal[1] - place[1], goal[0] - place[0])
        errands.append(Errand(Pose2D(*place, yaw), (goal, start), True, max(speed, SLOWEST_M_S)))
    return errands


def _random_way(
    config: Reactive, random: Generator
) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Return places on two opposite edges of an area, and a share of the way between them."""
    axis, direction, near, far, share = random.random(5).tolist()
    (left, right), (bottom, top) = config.x_m, config.y_m
    if axis < 0.5:
        ends = (
            (left, bottom + near * (top - bottom)),
            (right, bottom + far * (top - bottom)),
        )
    else:
        ends = (left + near * (right - left), bottom), (left + far * (right - left), top)
    start, goal = ends if direction < 0.5 else ends[::-1]
    return start, goal, share


class Pedestrians:
    """People on errands, step by step.

    Each walker has independent fluctuations from `seed`: a further walker does not change those of
    the others. Bodies have a `radius` [m].
    """

    def __init__(
        self,
        errands: Sequence[Errand],
        obstacles: Sequence[Box | Cylinder],
        radius: float,
        seed: int,
    ) -> None:
        self._errands, self._radius = errands, radius
        self.surround(obstacles)
        self._places: Floats = np.array([errand.start[:2] for errand in errands]).reshape(-1, 2)
        self._velocities: Floats = np.zeros_like(self._places)
        self._fastest = np.array([forces.FASTEST * errand.speed for errand in errands])
        self._next = [0] * len(errands)
        self._random = [Generator(PCG64([seed, n, 1])) for n in range(len(errands))]
        self.motions = [PersonMotion(errand.start) for errand in errands]

    def surround(self, obstacles: Sequence[Box | Cylinder]) -> None:
        """Give way to these obstacles of the world from now on."""
        self._shapes = forces.shapes_of(obstacles)

    def step(self, time: float, dt: float, agents: Sequence[Agent]) -> None:
        """Advance the walkers by `dt` to `time` [s]; they give way to `agents`."""
        if not self._errands:
            return
        preferred = np.array([self._preferred(n, time) for n in range(len(self._errands))])
        force = (preferred - self._velocities) / forces.RELAXATION_S
        force += self._repulsion(preferred, agents)
        force += forces.from_obstacles(self._places, self._shapes)
        chance = np.array([random.standard_normal(2) for random in self._random])
        force = forces.limited(force, forces.STRONGEST_M_S2) + forces.FLUCTUATION_M_S2 * chance
        self._velocities = forces.limited(self._velocities + force * dt, self._fastest)
        self._places = self._places + self._velocities * dt
        rows = zip(self.motions, self._places.tolist(), self._velocities.tolist(), strict=True)
        self.motions = [_walked(last, place, velocity, dt) for last, place, velocity in rows]

    def _repulsion(self, preferred: Floats, agents: Sequence[Agent]) -> Floats:
        """Return the acceleration (n, 2) of each walker by all walkers and agents [m/s²]."""
        walkers, around = len(self._errands), np.array([a[:4] for a in agents]).reshape(-1, 4)
        touching = np.full((walkers, walkers + len(agents)), 2.0 * self._radius)
        touching[:, walkers:] = [self._radius + agent.radius for agent in agents]
        np.fill_diagonal(touching, math.inf)
        repulsion: Floats = forces.repulsion(
            self._places,
            forces.limited(preferred * 1e3, 1.0),
            np.concatenate((self._places, around[:, :2])),
            np.concatenate((self._velocities, around[:, 2:])),
            touching,
        ).sum(axis=1)
        return repulsion

    def _preferred(self, number: int, time: float) -> tuple[float, float]:
        """Return the preferred velocity of a walker [m/s]."""
        errand = self._errands[number]
        if time < errand.start_after:
            return 0.0, 0.0
        x, y = self._places[number].tolist()
        goal_x, goal_y = errand.goals[self._next[number]]
        distance = math.hypot(goal_x - x, goal_y - y)
        if distance < ARRIVED_M:
            is_last = self._next[number] == len(errand.goals) - 1
            if is_last and not errand.endless:
                return 0.0, 0.0
            self._next[number] = 0 if is_last else self._next[number] + 1
        distance = max(distance, 1e-9)
        return errand.speed * (goal_x - x) / distance, errand.speed * (goal_y - y) / distance


def _walked(
    last: PersonMotion, place: Sequence[float], velocity: Sequence[float], dt: float
) -> PersonMotion:
    """Return a walker's motion; the body turns to its direction of travel at a human rate."""
    (x, y), (vx, vy), yaw = place, velocity, last.pose.yaw
    speed, rate = math.hypot(vx, vy), 0.0
    if speed > STANDING_M_S:
        lag = wrap(math.atan2(vy, vx) - yaw)
        rate = min(max(TURN_HZ * lag, -MAX_YAW_RATE), MAX_YAW_RATE)
    yaw = wrap(yaw + rate * dt)
    return PersonMotion(
        Pose2D(x, y, yaw), Twist2D(*rotate(vx, vy, -yaw), rate), last.distance + speed * dt
    )
