"""Goals of nominal paths: places around the person, the person's trail, and staying."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from mecazen.geometry import Pose2D, Standoff, wrap
from mecazen.portable import Floats, arctan2

from mecazen_follower.estimators import Estimate
from mecazen_follower.planner.law import Goals

TRAIL_M = 0.1
"""Spacing of the trail's points [m]."""
ASIDE = math.radians(45.0)
"""Angle about the person between the place to keep and its neighbours [rad]."""
ALIKE = math.radians(5.0)
"""Places whose bearings differ by less than this are the same [rad]."""


class Prediction(NamedTuple):
    """The person after each step: poses and velocities (steps, 3); the origin is the robot."""

    poses: Floats
    velocities: Floats

    @classmethod
    def of(cls, person: Estimate, robot: Pose2D, steps: int, dt: float) -> Prediction:
        """Return the estimator's prediction; the axes are those of odom."""
        later = [person.after(dt * (k + 1)) for k in range(steps)]
        poses = np.array([one.pose for one in later])
        poses[:, :2] -= robot[:2]
        return cls(poses, np.array([one.velocity for one in later]))


class Trail:
    """The person's past positions, up to the standoff plus 3 m back."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, float]] = deque()

    def add(self, person: Pose2D, standoff: float) -> None:
        """Add the person's position, in odom; `standoff` [m] is the distance to keep."""
        here = person.x, person.y
        if not self._points or math.dist(self._points[-1], here) >= TRAIL_M:
            self._points.append(here)
        while len(self._points) > round((standoff + 3.0) / TRAIL_M):
            self._points.popleft()

    def points(self, robot: Pose2D) -> Floats:
        """Return the trail (n, 2), oldest first, relative to the robot's position."""
        points: Floats = np.array(self._points).reshape(-1, 2) - robot[:2]
        return points


def goals_of(standoff: Standoff, person: Prediction, trail: Floats) -> Goals:
    """Return the modes: the place to keep, others around the person, the trail, and staying.

    In all modes the robot sees the person at the same angle as from the place to keep.
    """
    behind, mirrored = wrap(math.pi - standoff.bearing), wrap(-2.0 * standoff.bearing)
    turns = [0.0]
    for turn in (behind, ASIDE, -ASIDE, mirrored):
        if all(abs(wrap(turn - other)) > ALIKE for other in turns):
            turns.append(turn)
    steps, modes = len(person.poses), len(turns) + 2
    poses, velocities = np.zeros((steps, 3, modes)), np.zeros((steps, 3, modes))
    facing = standoff.heading - standoff.bearing  # relative to person→robot
    direction = person.poses[:, 2:] + (standoff.bearing + np.array(turns))
    reach = standoff.distance * np.stack((np.cos(direction), np.sin(direction)), axis=1)
    poses[:, :2, :-2] = person.poses[:, :2, None] + reach
    poses[:, 2, :-2] = direction + facing
    yaw_rate = person.velocities[:, 2:]
    velocities[:, 0, :-2] = person.velocities[:, :1] - yaw_rate * reach[:, 1]
    velocities[:, 1, :-2] = person.velocities[:, 1:2] + yaw_rate * reach[:, 0]
    velocities[:, 2, :-2] = yaw_rate

    # the trail; and staying, at the origin
    poses[:, :2, -2], velocities[:, :2, -2] = _along(trail, person, standoff.distance)
    off = poses[:, :2, -2:] - person.poses[:, :2, None]
    poses[:, 2, -2:] = arctan2(off[:, 1], off[:, 0]) + facing
    turn_rates = np.zeros(modes)
    turn_rates[:-2] = yaw_rate[0]
    return Goals(poses, velocities, turn_rates)


def _along(trail: Floats, person: Prediction, distance: float) -> tuple[Floats, Floats]:
    """Return points at a distance behind the person along the path, and their velocities."""
    way = np.concatenate((trail, person.poses[:, :2]))
    lengths = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))))
    speeds = np.hypot(person.velocities[:, 0], person.velocities[:, 1])
    at = np.maximum(lengths[len(trail) :] - distance, 0.0)
    x, y = (np.interp(at, lengths, axis) for axis in way.T)
    dx, dy = (np.interp(at + 0.1, lengths, axis) - v for axis, v in zip(way.T, (x, y), strict=True))
    length = np.maximum(np.hypot(dx, dy), 1e-6)
    return np.column_stack((x, y)), np.column_stack((dx, dy)) * (speeds / length)[:, None]
