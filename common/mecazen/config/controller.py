"""`[controller]`: keys, frames, geometry, limits and odometry of the wheel controller."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec

from mecazen.schema import Length, Live, NonNegative, Positive, Section, WheelRadius

Key = Annotated[str, msgspec.Meta(pattern=r"^[^/*$?#@\s]+(/[^/*$?#@\s]+)*$")]
"""A key without wildcards, on which samples can be published."""
Name = Annotated[str, msgspec.Meta(min_length=1)]
Diagonal = tuple[NonNegative, NonNegative, NonNegative, NonNegative, NonNegative, NonNegative]
"""Variances of x, y, z [m²] and of roll, pitch, yaw [rad²]; for a twist, the same per s²."""
Limit = Live[Annotated[float, msgspec.Meta(gt=0.0)]]
"""`inf` means no limit."""


class LinearLimits(Section):
    """Limits along x or y of base_link."""

    max_velocity_m_s: Limit = 2.0
    max_acceleration_m_s2: Limit = 2.5
    max_deceleration_m_s2: Live[Limit | None] = None
    """Left out: equal to max_acceleration_m_s2."""
    max_jerk_m_s3: Limit = math.inf


class AngularLimits(Section):
    """Limits of the yaw rate."""

    max_velocity_rad_s: Limit = 3.0
    max_acceleration_rad_s2: Limit = 8.0
    max_deceleration_rad_s2: Live[Limit | None] = None
    """Left out: equal to max_acceleration_rad_s2."""
    max_jerk_rad_s3: Limit = math.inf


class AxisLimits(Section):
    """Limits of the commanded twist, in base_link."""

    x: LinearLimits = LinearLimits()
    y: LinearLimits = LinearLimits()
    yaw: AngularLimits = AngularLimits()


class OdometryScale(Section):
    """Calibration of the wheel odometry: true over nominal motion of each axis."""

    x: Positive = 1.0
    y: Positive = 1.0
    yaw: Positive = 1.0


class ControllerConfig(Section):
    """The wheel controller."""

    command_key: Key = "cmd_vel"
    """Key of the commanded twist, in base_frame_id, for all that publish or receive it."""
    reference_timeout_s: Live[Positive] = 0.5
    """Simulated time after which a command is stale and the robot comes to rest."""
    limits: AxisLimits = AxisLimits()
    odometry_key: Key = "odom"
    """Key of the odometry, for all that publish or receive it."""
    odom_frame_id: Name = "odom"
    base_frame_id: Name = "base_link"
    """Child frame of the odometry. With another name, the URDF has this frame as the parent of
    base_link, at the same place: base_link is on the ground, as REP-105's base_footprint."""
    update_rate_hz: Positive | None = None
    """Rate of the odometry; it divides the tick rate. Left out: at every tick."""
    odometry: Literal["wheel", "ground_truth"] = "wheel"
    """Source of the odometry: the wheels' measured angles, or the simulator's truth."""
    half_wheelbase_m: Length | None = None
    """Half the distance between the axles; left out: from the robot file."""
    half_track_m: Length | None = None
    """Half the distance between left and right wheels; left out: from the robot file."""
    wheel_radius_m: WheelRadius | None = None
    """Left out: from the robot file."""
    odometry_scale: OdometryScale = OdometryScale()
    pose_covariance_diagonal: Diagonal = (1e-3, 1e-3, 0.0, 0.0, 0.0, 1e-2)
    twist_covariance_diagonal: Diagonal = (1e-3, 1e-3, 0.0, 0.0, 0.0, 1e-2)

    def __post_init__(self) -> None:
        if self.odom_frame_id in (self.base_frame_id, "base_link"):
            raise ValueError(
                f"odom_frame_id = {self.odom_frame_id!r} must differ from base_frame_id and from "
                "base_link"
            )
