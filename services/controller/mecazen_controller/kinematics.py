"""Four mecanum wheels with 45° rollers: kinematics, the limit of their speed, odometry."""

from __future__ import annotations

from dataclasses import dataclass
from operator import mul
from typing import NamedTuple

from mecazen.geometry import Pose2D, Twist2D


class WheelSpeeds(NamedTuple):
    """Angular speeds of the wheels [rad/s], positive forward, in the order of `WHEELS`."""

    front_left: float = 0.0
    front_right: float = 0.0
    rear_left: float = 0.0
    rear_right: float = 0.0

    def desaturate(self, max_speed: float) -> WheelSpeeds:
        """Return speeds in the same ratios with none above `max_speed` [rad/s].

        All four are scaled alike, so the robot is slower but moves in the same direction.
        """
        fastest = max(map(abs, self))
        if fastest <= max_speed:
            return self
        # Dividing first keeps each ratio within [-1, 1], so rounding never exceeds the limit.
        return WheelSpeeds(*(speed / fastest * max_speed for speed in self))


@dataclass(frozen=True)
class MecanumKinematics:
    """The ideal relation of body twist and wheel speeds: rollers at 45°, no slip.

    Lengths in metres: the wheels' radius, half the distance between the axles, half the
    distance between left and right wheels.

    Equations (1) to (7) of "Omniwheel Chassis' Model and Plugin for Gazebo Simulator", with
    s_FR = 2 half_wheelbase and s_RL = 2 half_track.
    """

    wheel_radius: float
    half_wheelbase: float
    half_track: float

    @property
    def lever(self) -> float:
        """Speed of a wheel's rim per yaw rate of the body [m]: s_RL/2 + s_FR/2."""
        return self.half_wheelbase + self.half_track

    def inverse(self, twist: Twist2D) -> WheelSpeeds:
        """Return the wheel speeds that move the body with `twist`, given in base_link."""
        r, turn = self.wheel_radius, self.lever * twist.yaw
        return WheelSpeeds(
            (twist.x - twist.y - turn) / r,
            (twist.x + twist.y + turn) / r,
            (twist.x + twist.y - turn) / r,
            (twist.x - twist.y + turn) / r,
        )

    def forward(self, speeds: WheelSpeeds) -> Twist2D:
        """Return the body's twist in base_link: the least-squares fit to four speeds."""
        fl, fr, rl, rr = speeds
        quarter = self.wheel_radius / 4
        return Twist2D(
            (fl + fr + rl + rr) * quarter,
            (-fl + fr + rl - rr) * quarter,
            (-fl + fr - rl + rr) * quarter / self.lever,
        )


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
        """Go on from `pose`, as `set_odometry` asks; the twist stays."""
        self.pose = pose
