"""What the wheels and the controller let the robot do: the limits of its twist in base_link."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import msgspec

from mecazen.config import Scenario
from mecazen.config.controller import AngularLimits, AxisLimits, LinearLimits


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


def axis_limits(limits: AxisLimits) -> tuple[Limits, Limits, Limits]:
    """Return the limits of x, y and yaw as numbers."""

    def numbers(axis: LinearLimits | AngularLimits) -> Limits:
        velocity, acceleration, deceleration, jerk = msgspec.structs.astuple(axis)
        return Limits(velocity, acceleration, deceleration or acceleration, jerk)

    return numbers(limits.x), numbers(limits.y), numbers(limits.yaw)


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
        return cls(rim_speed, *gains, axis_limits(scenario.controller.limits))
