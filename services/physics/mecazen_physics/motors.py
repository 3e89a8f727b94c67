"""The wheels' motors: from commands of speed or torque to commands of DART's joints."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any

import dartpy as dart
from mecazen.config import PhysicsConfig
from mecazen.config.services import Pid
from mecazen.robot import WHEELS, RealMotors, Robot
from mecazen.wheels import WheelCommand
from msgspec.structs import replace

STILL_RAD_S = 0.02
"""Below this speed Coulomb friction grows with speed, so that it does not flip its sign at rest."""
Values = tuple[float, ...]
"""Speeds [rad/s] or torques [N·m] of the four wheels."""


class Motors:
    """The four motors of a robot.

    A commanded speed is held by DART's servo within the motor's torque, or controlled by a PID for
    each wheel if `physics.drive` is "effort". Speeds and torques are clipped at the motor's limits,
    and a torque does not accelerate a wheel beyond its maximum speed. With a table `motors` in the
    robot file, the motors follow commands as real motors do, and a wheel gets the torque of its
    motor less the friction at the speed at which a step begins. `wheels` are joints in DART.
    """

    def __init__(self, robot: Robot, physics: PhysicsConfig, wheels: Sequence[Any]) -> None:
        self._wheels, self._dt = wheels, physics.dt_s
        self._max_torque = robot.wheels.max_torque_nm
        self._max_speed = robot.wheels.max_speed_rad_s
        self._wiring = [(abs(n) - 1, math.copysign(1.0, n)) for n in robot.wheels.wiring]
        self._real = real_motors(robot, physics)
        self._pids: list[WheelPid] = []
        self._gains = physics.pid if physics.drive == "effort" else None
        self._is_effort: bool | None = None
        """Whether the command is one of torques; None before the first command."""
        self._values: Values = (0.0,) * len(WHEELS)
        self._response: MotorModel | None = None
        """The response of real motors to commands of the present kind."""
        self._friction = [0.0] * len(WHEELS)
        """Friction torques of real motors in the last step [N·m]."""
        self._supplied = 1.0
        self._servo = False

    def command(self, command: WheelCommand, efforts: Sequence[float]) -> None:
        """Take a command from now on; `efforts` are the motors' last torques [N·m]."""
        if command.is_effort != self._is_effort:
            self._begin(efforts, is_effort=command.is_effort)
        limit = self._max_torque if command.is_effort else self._max_speed
        values = [sign * command.values[output] for output, sign in self._wiring]
        self._values = tuple([min(max(value, -limit), limit) for value in values])
        if self._real is not None and self._response is not None:
            self._response.give(self._values)
            self._supplied = supply(self._real.sag_per_nm, efforts)

    def _begin(self, efforts: Sequence[float], *, is_effort: bool) -> None:
        """Begin to follow commands of the other kind, without what remains of earlier ones."""
        self._is_effort = is_effort
        self._servo = not is_effort and self._gains is None
        for wheel in self._wheels:
            wheel.setActuatorType(dart.dynamics.SERVO if self._servo else dart.dynamics.FORCE)
        if self._gains is not None:
            self._pids = [WheelPid(self._gains, self._max_torque, self._dt) for _ in WHEELS]
        if self._real is not None:
            motors = replace(self._real, dead_band_rad_s=0.0) if is_effort else self._real
            self._response = MotorModel(motors, self._dt, efforts if is_effort else self._speeds())

    def step(self) -> None:
        """Set the commands of DART's joints for the next step."""
        speeds, values = self._speeds(), self._values
        if self._response is not None:
            values = self._response.step(self._supplied)
            self._friction = [self._response.friction(speed) for speed in speeds]
            for wheel, friction in zip(self._wheels, self._friction, strict=True):
                wheel.setForceUpperLimit(0, self._max_torque - friction)
                wheel.setForceLowerLimit(0, -self._max_torque - friction)
        if not self._servo:
            if not self._is_effort:
                goals = zip(self._pids, values, speeds, strict=True)
                values = tuple([pid.update(goal - speed) for pid, goal, speed in goals])
            torques = map(self._limited, values, speeds)
            values = tuple([t - f for t, f in zip(torques, self._friction, strict=True)])
        for wheel, value in zip(self._wheels, values, strict=True):
            wheel.setCommand(0, value)

    def torques(self) -> list[float]:
        """Return the torques of the motors in the last step [N·m]."""
        if self._servo:
            # DART's servo is a velocity constraint; its torque is that constraint's impulse.
            torques = [wheel.getConstraintImpulse(0) / self._dt for wheel in self._wheels]
        else:
            torques = [wheel.getCommand(0) for wheel in self._wheels]
        return [t + f for t, f in zip(torques, self._friction, strict=True)]

    def _speeds(self) -> list[float]:
        return [wheel.getVelocity(0) for wheel in self._wheels]

    def _limited(self, torque: float, speed: float) -> float:
        """Return the torque of a motor [N·m], within its limits at the wheel's speed [rad/s]."""
        upper = self._max_torque if speed < self._max_speed else 0.0
        lower = -self._max_torque if speed > -self._max_speed else 0.0
        return min(max(torque, lower), upper)


class WheelPid:
    """PID from speed error to torque, as control_toolbox's: the integral term is clamped.

    The PID is updated once per physics step of `dt` [s].
    """

    def __init__(self, gains: Pid, max_torque: float, dt: float) -> None:
        self._gains = gains
        self._max_torque = max_torque
        self._dt = dt
        self._integral = 0.0
        self._last_error: float | None = None

    def update(self, error: float) -> float:
        """Return the torque [N·m] for the speed error goal - speed [rad/s]."""
        gains = self._gains
        clamp = gains.i_clamp_nm
        self._integral += gains.i_nm * error * self._dt
        self._integral = min(max(self._integral, -clamp), clamp)
        slope = 0.0 if self._last_error is None else (error - self._last_error) / self._dt
        self._last_error = error
        torque = gains.p_nms * error + self._integral + gains.d_nms2 * slope
        return min(max(torque, -self._max_torque), self._max_torque)


class MotorModel:
    """The response of the four wheels to their commands, of speeds or of torques.

    It has steps of `dt` [s]; until the first command arrives, the output is `start`.
    """

    def __init__(
        self, motors: RealMotors, dt: float, start: Sequence[float] = (0.0,) * len(WHEELS)
    ) -> None:
        self._motors, self._dt = motors, dt
        self._steps = 0
        self._commands: deque[tuple[float, Values]] = deque()
        """Pending commands, with the times at which they arrive at the motors [s]."""
        self._newest: Values | None = None
        self._in_force: Values | None = None
        """The command that the motors follow; None: their output stays."""
        self._output: Values = tuple(start)

    def give(self, command: Sequence[float]) -> None:
        """Take a command from now on: speeds [rad/s], or torques [N·m]."""
        values = tuple(command)
        if values != self._newest:
            self._newest = values
            self._commands.append((self._steps * self._dt + self._motors.delay_s, values))

    def step(self, supplied: float) -> Values:
        """Return the output at the end of the next step: speeds [rad/s], or torques [N·m].

        The share `supplied` of the supply voltage remains under load.
        """
        now, end = self._steps * self._dt, (self._steps + 1) * self._dt
        while self._commands and self._commands[0][0] < end:
            arrival, values = self._commands.popleft()
            self._follow(max(arrival - now, 0.0), supplied)
            now, self._in_force = max(arrival, now), values
        self._follow(end - now, supplied)
        self._steps += 1
        return self._output

    def _follow(self, duration: float, supplied: float) -> None:
        """Follow the command in force, which is constant, for a duration [s]."""
        if self._in_force is None:
            return
        motors, output = self._motors, []
        lag, dead = motors.time_constant_s, motors.dead_band_rad_s
        left = math.exp(-duration / lag) if lag > 0.0 else float(duration == 0.0)
        for gain, command, value in zip(motors.gains, self._in_force, self._output, strict=True):
            aim = gain * supplied * math.copysign(max(abs(command) - dead, 0.0), command)
            output.append(aim + left * (value - aim))
        self._output = tuple(output)

    def friction(self, speed: float) -> float:
        """Return the friction torque of motor and gear [N·m] at a wheel's speed [rad/s]."""
        part = min(max(speed / STILL_RAD_S, -1.0), 1.0)
        return self._motors.coulomb_nm * part + self._motors.viscous_nms * speed


def real_motors(robot: Robot, physics: PhysicsConfig) -> RealMotors | None:
    """Return the real motors of a robot, or None if its motors are ideal."""
    return robot.motors if physics.motors == "robot" else None


def supply(sag_per_nm: float, torques: Sequence[float]) -> float:
    """Return the share of the supply voltage that remains under the motors' torques [N·m]."""
    load = math.fsum(map(abs, torques))
    return max(1.0 - sag_per_nm * load, 0.0)
