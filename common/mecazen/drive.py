"""What the wheels and the controller let the robot do: the limits of its twist in base_link."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import msgspec

from mecazen.config import Scenario
from mecazen.schema import Live, Positive, Section

Key = Annotated[str, msgspec.Meta(pattern=r"^[^/*$?#\s]+(/[^/*$?#\s]+)*$")]
"""A key expression without wildcards, as one publishes on."""

Limit = Live[Annotated[float, msgspec.Meta(gt=0.0)]]
"""`inf` is no limit."""


@dataclass(frozen=True)
class Limits:
    """Limits of one axis, per second, per second², per second³; infinite where there is none.

    Acceleration is a growing speed, deceleration a falling one, in either direction.
    """

    velocity: float = math.inf
    acceleration: float = math.inf
    deceleration: float = math.inf
    jerk: float = math.inf

    def reach(self, velocity: float, dt: float) -> tuple[float, float]:
        """Return the lowest and the highest velocity after `dt` [s], but for the jerk limit."""
        up, down = self.acceleration * dt, self.deceleration * dt
        low = velocity - (down if velocity > 0.0 else up)
        high = velocity + (down if velocity < 0.0 else up)
        return max(low, -self.velocity), min(high, self.velocity)


class _Limits(Section):
    @property
    def limits(self) -> Limits:
        """The same as numbers."""
        velocity, acceleration, deceleration, jerk = msgspec.structs.astuple(self)
        return Limits(velocity, acceleration, deceleration or acceleration, jerk)


class LinearLimits(_Limits):
    """Limits along x or y of base_link."""

    max_velocity_m_s: Limit = 2.0
    max_acceleration_m_s2: Limit = 2.5
    max_deceleration_m_s2: Live[Limit | None] = None
    """Left out: as max_acceleration_m_s2."""
    max_jerk_m_s3: Limit = math.inf


class AngularLimits(_Limits):
    """Limits of the yaw rate."""

    max_velocity_rad_s: Limit = 3.0
    max_acceleration_rad_s2: Limit = 8.0
    max_deceleration_rad_s2: Live[Limit | None] = None
    """Left out: as max_acceleration_rad_s2."""
    max_jerk_rad_s3: Limit = math.inf


class AxisLimits(Section):
    """Limits of the commanded twist, in base_link."""

    x: LinearLimits = LinearLimits()
    y: LinearLimits = LinearLimits()
    yaw: AngularLimits = AngularLimits()

    @property
    def limits(self) -> tuple[Limits, Limits, Limits]:
        """The limits of x, y, yaw as numbers."""
        return self.x.limits, self.y.limits, self.yaw.limits


class DriveConfig(Section):
    """What others need to know of the controller's section: what it obeys, and how fast."""

    command_key: Key = "cmd_vel"
    """Key of the commanded twist, in base_frame_id; with a guard, what the guard listens to."""
    reference_timeout_s: Live[Positive] = 0.5
    """Simulated time after which a command is stale and the robot comes to rest."""
    limits: AxisLimits = AxisLimits()

    @classmethod
    def of(cls, scenario: Scenario) -> DriveConfig:
        """Return a scenario's, be the controller installed here or not."""
        section: Any = scenario.sections.get("controller")
        if section is None:
            others = scenario.others.get("controller") or {}
            known = {name: others[name] for name in cls.__struct_fields__ if name in others}
            return msgspec.convert(known, DriveConfig)
        return DriveConfig(*(getattr(section, name) for name in cls.__struct_fields__))


class Drive(NamedTuple):
    """The twists (vx, vy, ω) that wheels and controller can follow.

    The wheels can where |vx| + sideways·|vy| + lever·|ω| <= rim_speed: no rim is faster than that.
    Without arguments nothing is limited.
    """

    rim_speed: float = math.inf
    """Of the wheels [m/s]."""
    sideways: float = 1.0
    """Speed of a rim per speed along y; 1 with rollers at 45°."""
    lever: float = 0.0
    """Speed of a rim per yaw rate [m]."""
    axes: tuple[Limits, Limits, Limits] = (Limits(), Limits(), Limits())
    """The controller's limits of x, y and yaw."""

    @classmethod
    def of(cls, scenario: Scenario) -> Drive:
        """Return the limits of a scenario's robot: its wheels', and those of its controller."""
        wheels, robot = scenario.robot.wheels, scenario.robot
        rim_speed = wheels.max_speed_rad_s * wheels.radius_m
        gains = abs(robot.cross_gain), abs(robot.lever)
        return cls(rim_speed, *gains, DriveConfig.of(scenario).limits.limits)
