"""The controller's section of a scenario."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from mecazen.drive import DriveConfig, Key
from mecazen.geometry import Twist2D
from mecazen.robot import WHEEL_JOINTS, Robot
from mecazen.schema import NonNegative, Positive, Section

from mecazen_controller.kinematics import MecanumKinematics

Name = Annotated[str, msgspec.Meta(min_length=1)]
Diagonal = tuple[NonNegative, NonNegative, NonNegative, NonNegative, NonNegative, NonNegative]
"""Variances of x, y, z [m²] and of roll, pitch, yaw [rad²]; of a twist, per s²."""


class OdometryScale(Section):
    """Calibration of the wheel odometry: true over nominal motion of each axis."""

    x: Positive = 1.0
    y: Positive = 1.0
    yaw: Positive = 1.0

    @property
    def factors(self) -> Twist2D:
        """The same for the odometry."""
        return Twist2D(self.x, self.y, self.yaw)


class ControllerConfig(DriveConfig):
    """The wheel controller: keys, frames, geometry, limits and odometry."""

    odometry_key: Key = "odom"
    odom_frame_id: Name = "odom"
    base_frame_id: Name = "base_link"
    update_rate_hz: Positive | None = None
    """Rate of the odometry; it divides the tick rate. Left out: at every tick."""
    odometry: Literal["wheel", "ground_truth"] = "wheel"
    """Integrated from the measured wheel speeds, or the simulator's truth."""
    wheel_joints: Annotated[tuple[Name, ...], msgspec.Meta(min_length=4, max_length=4)] = (
        WHEEL_JOINTS
    )
    """Joints of the front left, front right, rear left and rear right wheel."""
    half_wheelbase_m: Positive | None = None
    """Half the distance between the axles; left out: the robot file's."""
    half_track_m: Positive | None = None
    """Half the distance between left and right wheels; left out: the robot file's."""
    wheel_radius_m: Positive | None = None
    """Left out: the robot file's."""
    odometry_scale: OdometryScale = OdometryScale()
    pose_covariance_diagonal: Diagonal = (1e-3, 1e-3, 0.0, 0.0, 0.0, 1e-2)
    twist_covariance_diagonal: Diagonal = (1e-3, 1e-3, 0.0, 0.0, 0.0, 1e-2)

    def __post_init__(self) -> None:
        if len(set(self.wheel_joints)) != len(self.wheel_joints):
            raise ValueError(f"wheel_joints must be four different names: {self.wheel_joints}")

    def kinematics(self, robot: Robot) -> MecanumKinematics:
        """Return the kinematics: the lengths given here, else those of `robot`."""
        return MecanumKinematics(
            self.wheel_radius_m or robot.wheels.radius_m,
            self.half_wheelbase_m or robot.half_wheelbase,
            self.half_track_m or robot.half_track,
            robot.cross_gain,
        )
