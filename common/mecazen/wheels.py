"""The four mecanum wheels: their kinematics, their commands, and the watchdog that brakes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from mecazen.config import ControllerConfig, Scenario
from mecazen.drive import Drive, LimiterState, LimiterStates, axis_limits
from mecazen.errors import ConfigError, RefusedError
from mecazen.geometry import Twist2D
from mecazen.messages import JointState
from mecazen.robot import LEAST_LEVER, WHEELS, Robot
from mecazen.ticks import ROUNDING_S

NO_LENGTHS = ControllerConfig()
"""A configuration that leaves the lengths to the robot file."""
PLAUSIBLE_SPEED = 1.5
"""Highest plausible speed of a wheel, as a multiple of its maximum speed. A faster change of an
angle is a jump: a damaged number, or a counter that wrapped or started again."""


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
    """The ideal relation of body twist and wheel speeds, without slip.

    A roller whose axis is at γ to the axle resists only along its axis. For a wheel whose centre
    moves at (v_x, v_y) and whose rim moves at ωR, this means (v_x - ωR)·sin γ ∓ v_y·cos γ = 0, with
    the upper sign for front left and rear right wheels in the arrangement X.

    Lengths in metres: the wheels' radius, half the distance between the axles, half the
    distance between left and right wheels, and the wheels' centre in base_link. `cross_gain` is
    ±cot γ, see `Robot.cross_gain`.

    With rollers at 45° the relation is equations (1) to (7) of "Omniwheel Chassis' Model and Plugin
    for Gazebo Simulator", with s_FR = 2 half_wheelbase and s_RL = 2 half_track.
    """

    wheel_radius: float
    half_wheelbase: float
    half_track: float
    cross_gain: float = 1.0
    centre: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def from_robot(cls, robot: Robot, config: ControllerConfig = NO_LENGTHS) -> MecanumKinematics:
        """Return the kinematics with the lengths of the configuration, else of the robot file.

        Raises:
            ConfigError: The wheels of an O with such lengths can't turn the robot.
        """
        kinematics = cls(
            config.wheel_radius_m or robot.wheels.radius_m,
            config.half_wheelbase_m or robot.half_wheelbase,
            config.half_track_m or robot.half_track,
            robot.cross_gain,
            robot.wheels.centre_m,
        )
        if abs(kinematics.lever) < LEAST_LEVER * kinematics.half_track:
            raise ConfigError(
                f"controller.half_track_m = {kinematics.half_track:g}, half_wheelbase_m = "
                f"{kinematics.half_wheelbase:g}: with rollers.arrangement = 'O' the wheels have a "
                f"lever of {kinematics.lever:.3g} m, and can hardly turn the robot"
            )
        return kinematics

    @property
    def lever(self) -> float:
        """Speed of a wheel's rim per yaw rate of the body [m]: (s_RL + s_FR)/2 at 45°."""
        return self.half_track + self.cross_gain * self.half_wheelbase

    def inverse(self, twist: Twist2D) -> WheelSpeeds:
        """Return the wheel speeds that move the body with `twist`, given in base_link."""
        r, turn = self.wheel_radius, self.lever * twist.yaw
        ahead, left = self.centre
        x = twist.x - left * twist.yaw
        y = self.cross_gain * (twist.y + ahead * twist.yaw)
        return WheelSpeeds(
            (x - y - turn) / r,
            (x + y + turn) / r,
            (x + y - turn) / r,
            (x - y + turn) / r,
        )

    def forward(self, speeds: WheelSpeeds) -> Twist2D:
        """Return the body's twist in base_link: the least-squares fit to four speeds."""
        fl, fr, rl, rr = speeds
        quarter, (ahead, left) = self.wheel_radius / 4, self.centre
        yaw = (-fl + fr - rl + rr) * quarter / self.lever
        return Twist2D(
            (fl + fr + rl + rr) * quarter + left * yaw,
            (-fl + fr + rl - rr) * quarter / self.cross_gain - ahead * yaw,
            yaw,
        )


class WheelCommand(NamedTuple):
    """A command for the motors: speeds [rad/s] or torques [N·m], in the order of `WHEELS`."""

    values: Sequence[float]
    is_effort: bool = False


def wheel_values(
    joints: JointState, values: tuple[float, ...], names: tuple[str, ...]
) -> tuple[float, ...]:
    """Select the wheels' values from those of all joints; empty if a wheel is missing."""
    if joints.name[: len(names)] == names:  # physics publishes the wheels first
        return values[: len(names)] if len(values) >= len(names) else ()
    by_name = dict(zip(joints.name, values, strict=False))
    return tuple(by_name[name] for name in names) if by_name.keys() >= set(names) else ()


def wheel_command(joints: JointState, names: tuple[str, ...]) -> WheelCommand:
    """Return the velocities of the named joints [rad/s], or efforts [N·m] without velocities.

    Raises:
        RefusedError: A wheel has neither.
    """
    is_effort = bool(joints.effort) and not joints.velocity
    values = wheel_values(joints, joints.effort if is_effort else joints.velocity, names)
    if not values:
        raise RefusedError(f"needs a velocity or an effort of {names}")
    return WheelCommand(values, is_effort)


class Watchdog:
    """Brakes the wheels, as the controller does, once their command is too old.

    Args:
        scenario: The robot's part of the scenario.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._kinematics = MecanumKinematics.from_robot(scenario.robot)
        self._last = WheelCommand((0.0,) * len(WHEELS))
        self._braking: LimiterStates | None = None
        """Motion of the robot while the wheels brake."""
        self.configure(scenario)

    def configure(self, scenario: Scenario) -> None:
        """Brake within the limits of a changed scenario from now on."""
        self._timeout_s, self._tick_s = scenario.wheel_timeout_s, scenario.sim.tick_s
        self._drive = Drive(axes=axis_limits(scenario.controller.limits))

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
        self._braking = self._drive.limited(self._braking, Twist2D(), self._tick_s)
        twist = Twist2D(*(axis.velocity for axis in self._braking))
        return WheelCommand(self._kinematics.inverse(twist))
