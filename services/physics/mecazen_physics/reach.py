"""Which rollers can touch anything soon: the others need no collision detection."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS, Robot

MARGIN_RAD = 0.2
"""Beyond its arc a roller is clear of the ground: by R (1 - cos 0.2), 1 mm at R = 50 mm."""
MAX_TILT_RAD = 0.05
"""A base that leans more may touch the ground with any roller."""
SPEED_MARGIN = 1.5
"""How much faster than it turns, and is told to, a wheel may become within a tick."""
LONGEST_S = 0.02
"""Farther ahead neither the wheels' speeds can be foretold nor what a robot meets."""
CLEAR_M = 0.02
"""What is this far away, beside the way that both may go until one looks round, is not touched."""
GRIP_M_S2 = 10.0
"""No robot on the ground speeds up faster."""


class Footprint(NamedTuple):
    """What stands upright in the world, from above: a rectangle with a rim round it.

    The middle (x, y) and half the length, along `yaw` [rad], half the width, and the rim are in
    [m]; no point of it moves faster than `speed` [m/s].
    """

    x: float
    y: float
    yaw: float = 0.0
    half_length: float = 0.0
    half_width: float = 0.0
    rim: float = 0.0
    speed: float = 0.0

    @property
    def radius(self) -> float:
        """The circle round it [m]."""
        return math.hypot(self.half_length, self.half_width) + self.rim

    def gap(self, other: Footprint) -> float:
        """Return a distance [m] that is between the two at least: each against the other's circle.

        Where the other is a circle, the distance itself.
        """
        return max(self._to_circle(other), other._to_circle(self))

    def near(self, other: Footprint, margin: float = 1.0) -> bool:
        """Return whether the two may touch before `LONGEST_S` have passed.

        Args:
            other: Another one.
            margin: Factor on what is near.
        """
        reach = margin * (CLEAR_M + (self.speed + other.speed) * LONGEST_S)
        return self._to_circle(other) <= reach and other._to_circle(self) <= reach

    def _to_circle(self, other: Footprint) -> float:
        x, y = other.x - self.x, other.y - self.y
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        ahead = max(abs(cos * x + sin * y) - self.half_length, 0.0)
        aside = max(abs(cos * y - sin * x) - self.half_width, 0.0)
        return math.hypot(ahead, aside) - self.rim - other.radius


class Outline:
    """The robot from above."""

    def __init__(self, robot: Robot) -> None:
        radius = robot.wheels.radius_m
        self._half_length = max(robot.half_wheelbase + radius, robot.base.length_m / 2)
        self._half_width = max(robot.half_track + radius, robot.base.width_m / 2)
        self._radius = math.hypot(self._half_length, self._half_width)

    def at(self, pose: Pose2D, speed: float, yaw_rate: float) -> Footprint:
        """Return the footprint of the robot at a pose that moves with `speed` [m/s], [rad/s]."""
        fastest = speed + abs(yaw_rate) * self._radius + GRIP_M_S2 * LONGEST_S
        return Footprint(*pose, self._half_length, self._half_width, speed=fastest)


class Reach:
    """Leaves rollers out of collision detection while they can touch nothing.

    That changes no contact, only the time it takes to find them (and their order, so the last
    bits of a sum): a roller whose arc is not near the bottom is above the ground, and all of
    them count as soon as the robot leans or something else is near. The angle of a roller is
    counted from the bottom, where roller 0 of a wheel at 0 is.
    """

    def __init__(self, robot: Robot, rollers: Sequence[Any]) -> None:
        count = robot.rollers.count
        self._pitch = math.tau / count
        self._arc = math.pi / count + MARGIN_RAD + MAX_TILT_RAD
        self._wheels = [rollers[first : first + count] for first in range(0, len(rollers), count)]
        self._near = [[True] * count for _ in WHEELS]

    def update(
        self,
        angles: Sequence[float],
        fastest: Sequence[float],
        duration: float,
        *,
        alone: bool,
    ) -> None:
        """Choose for the next `duration` [s].

        Args:
            angles: Of the wheels [rad].
            fastest: The wheels' present or commanded speed, whichever is more [rad/s].
            duration: Of the next advance [s].
            alone: Whether no roller but the lowest of each wheel can touch anything.
        """
        for rollers, near, angle, speed in zip(
            self._wheels, self._near, angles, fastest, strict=True
        ):
            arc = self._arc + SPEED_MARGIN * speed * duration if alone else math.inf
            for index, roller in enumerate(rollers):
                reaches = abs(math.remainder(angle + index * self._pitch, math.tau)) < arc
                if reaches != near[index]:
                    near[index] = reaches
                    roller.setCollidable(reaches)
