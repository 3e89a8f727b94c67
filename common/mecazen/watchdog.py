"""The wheels' watchdog: passes commands to the motors, and brakes once no commands arrive."""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import NamedTuple

from mecazen.config import Scenario
from mecazen.drive import LimiterState, axis_limits, limit_twist
from mecazen.errors import RefusedError
from mecazen.geometry import Twist2D
from mecazen.kinematics import MecanumKinematics, WheelSpeeds
from mecazen.messages import JointState
from mecazen.robot import WHEELS
from mecazen.ticks import ROUNDING_S


class WheelCommand(NamedTuple):
    """A command for the motors: speeds [rad/s] or torques [N·m], in the order of `WHEELS`."""

    values: Sequence[float]
    is_effort: bool = False


def wheel_command(joints: JointState, names: Sequence[str]) -> WheelCommand:
    """Return the velocities of the named joints [rad/s], or efforts [N·m] without velocities.

    Raises:
        RefusedError: A wheel has neither.
    """
    is_effort = bool(joints.effort) and not joints.velocity
    values = joints.effort if is_effort else joints.velocity
    try:
        return WheelCommand(
            itemgetter(*names)(dict(zip(joints.name, values, strict=False))), is_effort
        )
    except KeyError:
        raise RefusedError(f"needs a velocity or an effort of {tuple(names)}") from None


class Watchdog:
    """Brakes the wheels, as the controller does, once their command is too old.

    Args:
        scenario: The robot's part of the scenario.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._kinematics = MecanumKinematics.of(scenario.robot)
        self._last = WheelCommand((0.0,) * len(WHEELS))
        self._braking: tuple[LimiterState, LimiterState, LimiterState] | None = None
        """Motion of the robot while the wheels brake."""
        self.configure(scenario)

    def configure(self, scenario: Scenario) -> None:
        """Brake within the limits of a changed scenario from now on."""
        self._timeout_s, self._tick_s = scenario.wheel_timeout_s, scenario.sim.tick_s
        self._limits = axis_limits(scenario.controller.limits)

    def command(
        self, new: WheelCommand | None, age_s: float, speeds: Sequence[float]
    ) -> WheelCommand:
        """Return the command that the motors obey.

        Args:
            new: A new command, if any.
            age_s: Age of the newest command [s].
            speeds: Measured speeds of the wheels [rad/s].
        """
        if new is not None:
            self._last = new
        if age_s <= self._timeout_s + ROUNDING_S:
            self._braking = None
            return self._last
        if self._braking is None:
            turning = WheelSpeeds(*(speeds if self._last.is_effort else self._last.values))
            x, y, yaw = map(LimiterState, self._kinematics.forward(turning))
            self._braking = x, y, yaw
        self._braking = limit_twist(self._braking, Twist2D(), self._limits, self._tick_s)
        x_m_s, y_m_s, yaw_rad_s = (axis.velocity for axis in self._braking)
        return WheelCommand(self._kinematics.inverse(Twist2D(x_m_s, y_m_s, yaw_rad_s)))
