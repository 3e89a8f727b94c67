"""A camera's pose and field of view, and the images of a depth camera, one ray per pixel."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from mecazen import messages as m
from mecazen.arrays import rotate
from mecazen.config.sensors import DepthConfig, TrackerConfig
from mecazen.geometry import Pose2D
from mecazen.portable import Floats, product
from mecazen.robot import CameraMount
from numpy.random import PCG64, Generator

from mecazen_sensors.raycast import CARRIER, RayScene

EDGE_STEP_M = 0.1
"""Difference of depth between neighbours that makes an edge [m]."""


class CameraView:
    """A pinhole camera on a robot: its pose and field of view."""

    def __init__(self, mount: CameraMount, config: TrackerConfig | DepthConfig) -> None:
        self._mount = mount
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
        x, y, _ = robot.compose(self._mount.pose)
        return np.array((x, y, self._mount.position_m[2]))

    def look(self, vectors: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
        """Return depths [m] of points, and whether they are in view.

        The points are vectors (n, 3) from the optical centre in base_link.
        """
        products = product(vectors, self._planes)
        inside: npt.NDArray[np.bool_] = np.logical_and.reduce(products >= self._least, axis=1)
        return products[:, 0], inside


class DepthCamera:
    """A depth camera on a robot.

    The value of a pixel is the depth along the optical axis, or 0 if it is out of range or lost.
    Noise is Gaussian and grows with the square of depth. A pixel at an edge, next to a much nearer
    neighbour, mixes both depths: its value is between the two ("flying"), or lost.

    The number of random draws per image does not depend on its content.
    """

    def __init__(self, config: DepthConfig, mount: CameraMount, seed: int) -> None:
        self._config, self._frame = config, mount.optical_frame
        self._camera = CameraView(mount, config)
        width, height = config.width, config.height
        self._focal = width / 2 / self._camera.wide, height / 2 / self._camera.high
        left = (width / 2 - 0.5 - np.arange(width)) / self._focal[0]
        up = (height / 2 - 0.5 - np.arange(height)) / self._focal[1]
        ahead, y, z = np.broadcast_arrays(1.0, left[None, :], up[:, None])
        vectors = np.stack((ahead, y, z), axis=-1).reshape(-1, 3)
        lengths = np.linalg.norm(vectors, axis=1)
        self._rays: Floats = product(vectors / lengths[:, None], self._camera.axes)
        self._depths_per_range: Floats = 1.0 / lengths
        # no pixel's ray is longer than that of a corner
        self._farthest = config.max_range_m * float(np.max(lengths))
        self._random = Generator(PCG64(seed))

    def picture(self, scene: RayScene, robot: Pose2D, time: m.Time) -> m.Image:
        """Return the image from a true pose of the robot; `header.stamp` is `time`."""
        config = self._config
        shape = config.height, config.width
        noise: Floats = self._random.standard_normal(shape)
        chance: Floats = self._random.random(shape)
        directions = rotate(self._rays, robot.yaw)
        camera = self._camera.position(robot)
        ranges, _ = scene.cast(camera, directions, CARRIER, self._farthest)
        depths = (ranges * self._depths_per_range).reshape(shape)
        far = 2.0 * config.max_range_m  # stands for no return
        depths[depths > far] = far
        near = _nearest(depths)
        edge = depths - near > EDGE_STEP_M
        lost = edge & (chance < config.edge_probability)
        flying = edge & (chance > 1.0 - config.edge_probability)
        if config.edge_probability > 0.0:
            mixture = (chance - 1.0) / config.edge_probability + 1.0  # uniform from 0 to 1
            depths = np.where(flying, near + mixture * (depths - near), depths)
        depths += config.noise_m * depths * depths * noise
        is_valid = (depths >= config.min_range_m) & (depths <= config.max_range_m) & ~lost
        pixels = np.where(is_valid, np.rint(depths * 1000.0), 0.0).astype("<u2")
        return m.Image(
            header=m.Header(stamp=time, frame_id=self._frame),
            height=config.height,
            width=config.width,
            encoding="16UC1",
            step=2 * config.width,
            data=pixels.tobytes(),
        )

    def info(self, time: m.Time) -> m.CameraInfo:
        """Return the camera's projection: a pinhole without distortion."""
        (fx, fy), width, height = self._focal, self._config.width, self._config.height
        # the middle of pixel (0, 0) is at (0, 0)
        cx, cy = width / 2 - 0.5, height / 2 - 0.5
        return m.CameraInfo(
            header=m.Header(stamp=time, frame_id=self._frame),
            height=height,
            width=width,
            distortion_model="plumb_bob",
            d=(0.0,) * 5,
            k=(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
            r=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
            p=(fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0),
        )


def _nearest(depths: npt.NDArray[np.float64]) -> Floats:
    """Return the minimum depth of each pixel and its four neighbours."""
    near = depths.copy()
    np.minimum(near[1:], depths[:-1], out=near[1:])
    np.minimum(near[:-1], depths[1:], out=near[:-1])
    np.minimum(near[:, 1:], depths[:, :-1], out=near[:, 1:])
    np.minimum(near[:, :-1], depths[:, 1:], out=near[:, :-1])
    return near
