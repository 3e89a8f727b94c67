"""Footprints: which bodies can touch each other soon."""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D

HORIZON_S = 0.02
"""Maximum time between two checks of a robot's surroundings, and horizon of the prediction [s]."""
CLEARANCE_M = 0.02
"""Margin that is added to the distance that two footprints can travel within the horizon [m]."""
MAX_ACCELERATION_M_S2 = 10.0
"""Maximum acceleration of a robot on the ground."""


class Footprint(NamedTuple):
    """An upright body seen from above: a rectangle with a rim round it, in the world frame.

    The centre (x, y), half the length, along `yaw` [rad], half the width, and the rim are in [m].
    No point of the body moves faster than `speed` [m/s].
    """

    x: float
    y: float
    yaw: float = 0.0
    half_length: float = 0.0
    half_width: float = 0.0
    rim: float = 0.0
    speed: float = 0.0

    @classmethod
    def of_robot(
        cls, extents: tuple[float, float], pose: Pose2D, speed: float, yaw_rate: float
    ) -> Footprint:
        """Return the footprint of a robot with `Robot.footprint` = `extents`.

        The robot's base_link is at `pose` in the world frame and moves with `speed` [m/s] and
        `yaw_rate` [rad/s].
        """
        gain = MAX_ACCELERATION_M_S2 * HORIZON_S
        return cls(*pose, *extents, speed=speed + abs(yaw_rate) * math.hypot(*extents) + gain)

    @classmethod
    def of_obstacle(cls, obstacle: Box | Cylinder) -> Footprint:
        """Return the footprint of an obstacle."""
        if isinstance(obstacle, Cylinder):
            return cls(*obstacle.position_m, rim=obstacle.size_m[0])
        length, width, _ = obstacle.size_m
        yaw = math.radians(obstacle.yaw_deg)
        return cls(*obstacle.position_m, yaw, length / 2, width / 2)

    @property
    def radius(self) -> float:
        """Radius of the circle round the footprint [m]."""
        return math.hypot(self.half_length, self.half_width) + self.rim

    def gap(self, neighbour: Footprint) -> float:
        """Return a lower bound of the distance between the two [m].

        The bound is the largest gap along the axes of both footprints, and between each and the
        other's circle. If one footprint is a circle, the bound is exact.
        """
        return max(
            self._gap_along_axes(neighbour),
            neighbour._gap_along_axes(self),
            self._gap_to_circle(neighbour),
            neighbour._gap_to_circle(self),
        )

    def travel(self, neighbour: Footprint) -> float:
        """Return how much closer the two may come within the horizon, plus the clearance [m]."""
        return CLEARANCE_M + (self.speed + neighbour.speed) * HORIZON_S

    def may_touch(self, neighbour: Footprint, margin: float = 1.0) -> bool:
        """Return whether the two may touch within the horizon; `margin` scales `travel`."""
        travel = margin * self.travel(neighbour)
        return self._gap_to_circle(neighbour) <= travel and neighbour._gap_to_circle(self) <= travel

    def _gap_along_axes(self, neighbour: Footprint) -> float:
        ahead, aside = self._offsets(neighbour)
        turn = neighbour.yaw - self.yaw
        cos, sin = abs(math.cos(turn)), abs(math.sin(turn))
        length = cos * neighbour.half_length + sin * neighbour.half_width
        width = sin * neighbour.half_length + cos * neighbour.half_width
        return max(ahead - length, aside - width) - self.rim - neighbour.rim

    def _gap_to_circle(self, neighbour: Footprint) -> float:
        ahead, aside = self._offsets(neighbour)
        return math.hypot(max(ahead, 0.0), max(aside, 0.0)) - self.rim - neighbour.radius

    def _offsets(self, neighbour: Footprint) -> tuple[float, float]:
        """Return the distances of the other's centre beyond the sides, along x and y [m]."""
        x, y = neighbour.x - self.x, neighbour.y - self.y
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        ahead = abs(cos * x + sin * y) - self.half_length
        aside = abs(cos * y - sin * x) - self.half_width
        return ahead, aside
