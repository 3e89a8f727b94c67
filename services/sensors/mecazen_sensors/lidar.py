"""A 2D lidar: the ranges of one turn, all at the same time, in a horizontal plane."""

from __future__ import annotations

import math

import numpy as np
from mecazen import messages as m
from mecazen.arrays import rotate
from mecazen.config.sensors import LidarConfig
from mecazen.geometry import Pose2D
from mecazen.portable import Floats
from mecazen.robot import LidarMount
from mecazen.wire import NS_PER_S
from numpy.random import PCG64, Generator

from mecazen_sensors.raycast import CARRIER, RayScene

STEPS_PER_M = 1024.0
"""Number of range steps per metre: about a millimetre, as in such sensors, but exact in ROS's
32-bit floats and short in JSON."""
INVALID = 0.0
"""The range of a beam without a valid measurement; see `LaserScan`."""


def _single(value: float) -> float:
    """Return `value` rounded to 32 bits."""
    return float(np.float32(value))


class Lidar:
    """A lidar on a robot.

    Noise is Gaussian, and a share of beams has no valid measurement (Thrun, Burgard & Fox,
    Probabilistic Robotics, 2005, section 6.3; the unexpected objects of that model are shapes
    here). The number of random draws per scan does not depend on its content.
    """

    def __init__(self, config: LidarConfig, mount: LidarMount, seed: int) -> None:
        self._config, self._mount = config, mount
        fov = math.radians(config.fov_deg)
        gaps = config.beams if config.fov_deg == 360.0 else config.beams - 1  # both ends coincide
        self._first, self._step = _single(-fov / 2), _single(fov / gaps)
        angles = self._first + self._step * np.arange(config.beams)
        self._last = _single(angles[-1])
        self._farthest = math.floor(config.max_range_m * STEPS_PER_M) / STEPS_PER_M
        self._no_return = _single(config.max_range_m + 1.0)
        self._beams = np.stack((np.cos(angles), np.sin(angles), np.zeros(config.beams)), axis=-1)
        self._random = Generator(PCG64(seed))

    def scan(self, scene: RayScene, robot: Pose2D, time: m.Time) -> m.LaserScan:
        """Return the scan of the robot at a true pose; `header.stamp` is `time`."""
        config, mount = self._config, self._mount
        x, y, _ = robot.compose(mount.pose)
        origin = np.array((x, y, mount.position_m[2]))
        directions = rotate(self._beams, robot.yaw)
        noise: Floats = self._random.standard_normal(config.beams)
        lost = self._random.random(config.beams) < config.dropout_probability
        ranges, hits = scene.cast(origin, directions, CARRIER, config.max_range_m)
        ranges += config.range_std_m * noise
        ranges = np.minimum(np.rint(ranges * STEPS_PER_M) / STEPS_PER_M, self._farthest)
        ranges = np.maximum(ranges, 1.0 / STEPS_PER_M)  # an object that is too close is not 0
        ranges[lost] = INVALID
        ranges[hits < 0] = self._no_return
        if any(begin <= time.ns / NS_PER_S <= end for begin, end in config.occlusions_s):
            ranges[:] = INVALID
        return m.LaserScan(
            header=m.Header(stamp=time, frame_id=mount.frame),
            angle_min=self._first,
            angle_max=self._last,
            angle_increment=self._step,
            scan_time=_single(1.0 / config.rate_hz),
            range_min=_single(config.min_range_m),
            range_max=_single(config.max_range_m),
            ranges=tuple(ranges.tolist()),
        )
