"""Odometry from the motion of the wheels."""

from __future__ import annotations

from operator import mul

from mecazen.geometry import Pose2D, Twist2D

NOMINAL = Twist2D(1.0, 1.0, 1.0)
"""The scale of an odometry that is not calibrated."""


class DeadReckoning:
    """The pose of base_link in odom, and the twist in base_link of the last update.

    `scale` multiplies the twist, axis by axis: true over nominal, from a calibration. A
    mecanum robot mostly needs one below 1 for y.
    """

    def __init__(self, scale: Twist2D = NOMINAL) -> None:
        self.pose = Pose2D()
        self.twist = Twist2D()
        self._scale = scale

    def update(self, twist: Twist2D, dt: float) -> Pose2D:
        """Move with constant body `twist` for `dt` [s] and return the new pose; exact."""
        self.twist = Twist2D(*map(mul, twist, self._scale))
        self.pose = self.pose.integrate(self.twist, dt)
        return self.pose

    def set(self, pose: Pose2D) -> None:
        """Continue from `pose`, as `set_odometry` requests; the twist stays."""
        self.pose = pose
