"""Observed poses: from the sensor's frame to odom, and covariances from ROS's shape to ours."""

from __future__ import annotations

import math
from operator import itemgetter

import numpy as np
from mecazen.geometry import Pose2D
from mecazen.messages import PoseWithCovariance

from mecazen_follower.estimators import MAX_DISTANCE, Covariance
from mecazen_follower.following import Sighting

PLANAR = itemgetter(0, 1, 5, 6, 7, 11, 30, 31, 35)
"""Takes rows and columns of x, y and yaw out of ROS's row-major 6x6."""


def in_odom(seen: PoseWithCovariance, frame_id: str, robot: Pose2D) -> Sighting:
    """Return an observed pose and its 3x3 covariance of (x, y, yaw) in odom.

    `robot` is base_link in odom at the time of the capture. What comes in `base_link` is
    moved by it; what comes in another frame (world, odom) is taken to be in odom already.

    Raises:
        ValueError: Numbers so large that they can't be turned.
    """
    pose = seen.pose.to_planar()
    covariance = np.reshape(PLANAR(seen.covariance), (3, 3))
    if max(abs(pose.x), abs(pose.y), np.abs(covariance).max()) > MAX_DISTANCE**2:
        raise ValueError("observation is out of range")
    if frame_id != "base_link":
        return Sighting(pose, covariance)
    c, s = math.cos(robot.yaw), math.sin(robot.yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Sighting(robot.compose(pose), turn @ covariance @ turn.T)


def ros_covariance(covariance: Covariance) -> tuple[float, ...]:
    """Return ROS's row-major 6x6 of a 3x3 covariance of (x, y, yaw)."""
    (xx, xy, xw), (yx, yy, yw), (wx, wy, ww) = covariance
    none = 0.0, 0.0, 0.0
    return (xx, xy, *none, xw, yx, yy, *none, yw, *6 * none, wx, wy, *none, ww)
