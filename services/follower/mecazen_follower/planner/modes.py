"""Nominal ways: places about the person, the person's own trail, and to stay."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from mecazen.geometry import Pose2D, wrap
from mecazen.portable import Floats, arctan2
from mecazen.standoff import Standoff

from mecazen_follower.estimators import Estimate
from mecazen_follower.planner.law import Goals

TRAIL_M = 0.1
"""From one point of the trail to the next."""
ASIDE = math.radians(45.0)
"""Between the place to keep and the next ones that are tried."""
ALIKE = math.radians(5.0)
"""Places that differ by less are one."""


class Prediction(NamedTuple):
    """The person after each step: poses and velocities (steps, 3), from the robot's place on."""

    poses: Floats
    velocities: Floats

    @classmethod
    def of(cls, person: Estimate, robot: Pose2D, steps: int, dt: float) -> Prediction:
        """Return what the estimator predicts; the axes are those of odom."""
        later = [person.after(dt * (k + 1)) for k in range(steps)]
        poses = np.array([one.pose for one in later])
        poses[:, :2] -= robot[:2]
        return cls(poses, np.array([one.velocity for one in later]))


class Trail:
    """Where the person has walked, as far back as the robot may be."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, float]] = deque()

    def add(self, person: Pose2D, standoff: float) -> None:
        """Note where the person is, in odom; `standoff` [m] is the distance to keep."""
        here = person.x, person.y
        if not self._points or math.dist(self._points[-1], here) >= TRAIL_M:
            self._points.append(here)
        while len(self._points) > round((standoff + 3.0) / TRAIL_M):
            self._points.popleft()

    def points(self, robot: Pose2D) -> Floats:
        """Return the trail (n, 2), oldest first, from the robot's place on."""
        points: Floats = np.array(self._points).reshape(-1, 2) - robot[:2]
        return points


def goals_of(standoff: Standoff, person: Prediction, trail: Floats) -> Goals:
    """Return the modes: the place to keep, others about the person, the trail, and to stay.

    All but the first are turned about the person so that the robot sees them as it does there.
    """
    behind, mirrored = wrap(math.pi - standoff.bearing), wrap(-2.0 * standoff.bearing)
    turns = [0.0]
    for turn in (behind, ASIDE, -ASIDE, mirrored):
        if all(abs(wrap(turn - other)) > ALIKE for other in turns):
            turns.append(turn)
    steps, modes = len(person.poses), len(turns) + 2
    poses, velocities = np.zeros((steps, 3, modes)), np.zeros((steps, 3, modes))
    facing = standoff.heading - standoff.bearing  # heading, from the direction person to robot
    direction = person.poses[:, 2:] + (standoff.bearing + np.array(turns))
    reach = standoff.distance * np.stack((np.cos(direction), np.sin(direction)), axis=1)
    poses[:, :2, :-2] = person.poses[:, :2, None] + reach
    poses[:, 2, :-2] = direction + facing
    yaw_rate = person.velocities[:, 2:]
    velocities[:, 0, :-2] = person.velocities[:, :1] - yaw_rate * reach[:, 1]
    velocities[:, 1, :-2] = person.velocities[:, 1:2] + yaw_rate * reach[:, 0]
    velocities[:, 2, :-2] = yaw_rate

    # the trail; and to stay, at the origin
    poses[:, :2, -2], velocities[:, :2, -2] = _along(trail, person, standoff.distance)
    off = poses[:, :2, -2:] - person.poses[:, :2, None]
    poses[:, 2, -2:] = arctan2(off[:, 1], off[:, 0]) + facing
    turn_rates = np.zeros(modes)
    turn_rates[:-2] = yaw_rate[0]
    return Goals(poses, velocities, turn_rates)


def _along(trail: Floats, person: Prediction, distance: float) -> tuple[Floats, Floats]:
    """Return places a distance behind the person along their way, and the velocities there."""
    way = np.concatenate((trail, person.poses[:, :2]))
    lengths = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))))
    speeds = np.hypot(person.velocities[:, 0], person.velocities[:, 1])
    at = np.maximum(lengths[len(trail) :] - distance, 0.0)
    x, y = (np.interp(at, lengths, axis) for axis in way.T)
    dx, dy = (np.interp(at + 0.1, lengths, axis) - v for axis, v in zip(way.T, (x, y), strict=True))
    length = np.maximum(np.hypot(dx, dy), 1e-6)
    return np.column_stack((x, y)), np.column_stack((dx, dy)) * (speeds / length)[:, None]
