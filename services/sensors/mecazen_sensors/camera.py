"""Pose and field of view of a camera."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from mecazen.config.sensors import DepthConfig, TrackerConfig
from mecazen.geometry import Pose2D
from mecazen.portable import Floats, product
from mecazen.robot import CameraMount


class Camera:
    """A pinhole camera on a robot: its pose and field of view."""

    def __init__(self, mount: CameraMount, config: TrackerConfig | DepthConfig) -> None:
        self._place = mount.position_m
        self.axes = np.array(mount.axes)
        """Unit vectors in base_link (3, 3): its rows point ahead, to the left and up."""
        self.wide = math.tan(math.radians(config.horizontal_fov_deg) / 2)
        """Half the width of the view at a depth of 1."""
        self.high = math.tan(math.radians(config.vertical_fov_deg) / 2)
        """Half the height of the view at a depth of 1."""
        # a vector in base_link is in view if its products with six columns ...
        ahead, left, up = self.axes
        wide, high = self.wide * ahead, self.high * ahead
        planes = ahead, -ahead, wide + left, wide - left, high + up, high - up
        self._planes = np.stack(planes, axis=-1)
        # ... are at least
        self._least = np.array((config.min_range_m, -config.max_range_m, 0.0, 0.0, 0.0, 0.0))

    def position(self, robot: Pose2D) -> Floats:
        """Return the optical centre in the world (3,) [m], for a robot at a pose in the world."""
        c, s = math.cos(robot.yaw), math.sin(robot.yaw)
        x, y, z = self._place
        return np.array((robot.x + c * x - s * y, robot.y + s * x + c * y, z))

    def look(self, vectors: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
        """Return depths [m] of points, and whether they are in view.

        The points are vectors (n, 3) from the optical centre in base_link.
        """
        products = product(vectors, self._planes)
        inside: npt.NDArray[np.bool_] = np.logical_and.reduce(products >= self._least, axis=1)
        return products[:, 0], inside
