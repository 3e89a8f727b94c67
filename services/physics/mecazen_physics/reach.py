"""Which rollers can touch anything soon: the others need no collision detection."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from mecazen.robot import WHEELS, Robot

MARGIN_RAD = 0.2
"""Beyond its arc a roller is clear of the ground: by R (1 - cos 0.2), 1 mm at R = 50 mm."""
MAX_TILT_RAD = 0.05
"""A base that leans more may touch the ground with any roller."""
SPEED_MARGIN = 1.5
"""How much faster than it turns, and is told to, a wheel may become within a tick."""
NEAR_M = 0.2
"""Farther than this from its outline, nothing touches the robot within a tick."""


class Circle(NamedTuple):
    """What stands upright in the world, from above [m]."""

    x: float
    y: float
    radius: float


class Outline:
    """The robot from above, a circle: is it alone?"""

    def __init__(self, robot: Robot) -> None:
        self._radius = math.hypot(
            max(robot.half_wheelbase + robot.wheels.radius_m, robot.base.length_m / 2),
            max(robot.half_track + robot.wheels.radius_m, robot.base.width_m / 2),
        )

    def alone(
        self, x: float, y: float, tilt: float, others: Sequence[Circle], margin: float = 1.0
    ) -> bool:
        """Return whether no roller but the lowest of each wheel can touch anything soon.

        Args:
            x: Of base_link [m].
            y: Of base_link [m].
            tilt: Angle between the base's vertical and the world's [rad].
            others: What else there is to touch.
            margin: Factor on what is far and what is upright enough.
        """
        free = self._radius + margin * NEAR_M
        return margin * tilt < MAX_TILT_RAD and all(
            math.hypot(x - other.x, y - other.y) > free + other.radius for other in others
        )


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
            alone: See `Outline`.
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
