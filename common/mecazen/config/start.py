"""`[start]`: the start pose of the robot."""

from __future__ import annotations

import math

from mecazen.geometry import Pose2D
from mecazen.schema import AngleDeg, Finite, Section


class StartConfig(Section):
    """The start pose of the robot, in world; the odometry begins there too."""

    x_m: Finite = 0.0
    y_m: Finite = 0.0
    yaw_deg: AngleDeg = 0.0

    @property
    def pose(self) -> Pose2D:
        """The pose in world."""
        return Pose2D(self.x_m, self.y_m, math.radians(self.yaw_deg))
