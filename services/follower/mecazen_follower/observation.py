"""Observed poses: from the sensor's frame to odom, and covariances from ROS's shape to ours."""

from __future__ import annotations

import math
from operator import itemgetter

from mecazen.geometry import Pose2D
from mecazen.messages import PoseWithCovariance

from mecazen_follower.estimators import MAX_DISTANCE, Covariance
from mecazen_follower.following import Measurement

PLANAR = itemgetter(0, 1, 5, 6, 7, 11, 30, 31, 35)
"""Takes rows and columns of x, y and yaw out of ROS's row-major 6x6."""


def in_odom(seen: PoseWithCovariance, frame_id: str, robot: Pose2D) -> Measurement:
    """Return an observed pose and its 3x3 covariance of (x, y, yaw) in odom.

    `robot` is base_link in odom at the time of the capture. What comes in `base_link` is
    moved by it; what comes in another frame (world, odom) is taken to be in odom already.

    Raises:
        ValueError: Numbers so large that they can't be turned.
    """
    pose = seen.pose.to_planar()
    xx, xy, xw, yx, yy, yw, wx, wy, ww = covariance = PLANAR(seen.covariance)
    if max(map(abs, (pose.x, pose.y, *covariance))) > MAX_DISTANCE**2:
        raise ValueError("observation is out of range")
    if frame_id != "base_link":
        return Measurement(pose, ((xx, xy, xw), (yx, yy, yw), (wx, wy, ww)))
    c, s = math.cos(robot.yaw), math.sin(robot.yaw)
    # R C Rᵀ, R the rotation by the robot's heading: first R C of x and y, then all
    cxx, cxy, cyx, cyy = c * xx - s * yx, c * xy - s * yy, s * xx + c * yx, s * xy + c * yy
    turned = (
        (c * cxx - s * cxy, s * cxx + c * cxy, c * xw - s * yw),
        (c * cyx - s * cyy, s * cyx + c * cyy, s * xw + c * yw),
        (c * wx - s * wy, s * wx + c * wy, ww),
    )
    return Measurement(robot.compose(pose), turned)


def ros_covariance(covariance: Covariance) -> tuple[float, ...]:
    """Return ROS's row-major 6x6 of a 3x3 covariance of (x, y, yaw)."""
    (xx, xy, xw), (yx, yy, yw), (wx, wy, ww) = covariance
    none = 0.0, 0.0, 0.0
    return (xx, xy, *none, xw, yx, yy, *none, yw, *6 * none, wx, wy, *none, ww)
