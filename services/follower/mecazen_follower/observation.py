"""Observed poses: from the sensor's frame to odom."""

from __future__ import annotations

import math

from mecazen.covariance import planar_covariance
from mecazen.geometry import Pose2D
from mecazen.messages import PoseWithCovariance

from mecazen_follower.estimators import MAX_DISTANCE
from mecazen_follower.following import Measurement


def in_odom(observed: PoseWithCovariance, frame_id: str, robot: Pose2D) -> Measurement:
    """Return an observed pose and its 3x3 covariance of (x, y, yaw) in odom.

    `robot` is base_link in odom at the time of the capture. A pose in `base_link` is
    transformed by it; a pose in another frame (world, odom) is taken to be in odom already.

    Raises:
        ValueError: The numbers are too large to be rotated.
    """
    pose, covariance = observed.pose.to_planar(), planar_covariance(observed.covariance)
    (xx, xy, xw), (yx, yy, yw), (wx, wy, ww) = covariance
    if max(map(abs, (pose.x, pose.y, xx, xy, xw, yx, yy, yw, wx, wy, ww))) > MAX_DISTANCE**2:
        raise ValueError("observation is out of range")
    if frame_id != "base_link":
        return Measurement(pose, covariance)
    c, s = math.cos(robot.yaw), math.sin(robot.yaw)
    # R C Rᵀ, R the rotation by the robot's heading: first R C over x and y, then the product
    cxx, cxy, cyx, cyy = c * xx - s * yx, c * xy - s * yy, s * xx + c * yx, s * xy + c * yy
    rotated = (
        (c * cxx - s * cxy, s * cxx + c * cxy, c * xw - s * yw),
        (c * cyx - s * cyy, s * cyx + c * cyy, s * xw + c * yw),
        (c * wx - s * wy, s * wx + c * wy, ww),
    )
    return Measurement(robot.compose(pose), rotated)
