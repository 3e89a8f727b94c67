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
    robot file, the motors follow commands as real motors do, and friction is subtracted from the
    torque at a wheel.

    Args:
        robot: The robot, with the motors' limits.
        physics: Settings of the drive.
        wheels: The wheels' joints in DART.
    """

    def __init__(self, robot: Robot, physics: PhysicsConfig, wheels: Sequence[Any]) -> None:
        self._wheels, self._dt = wheels, physics.dt_s
        self._max_torque = robot.wheels.max_torque_nm
        self._max_speed = robot.wheels.max_speed_rad_s
        self._real = robot.motors if physics.motors == "robot" else None
        self._pids: list[WheelPid] = []
        if physics.drive == "effort":
            self._pids = [WheelPid(physics.pid, self._max_torque, physics.dt_s) for _ in WHEELS]
        self._responses: dict[bool, MotorModel] = {}
        """The responses of real motors to speeds and to torques."""
        if self._real is not None:
            torque = replace(self._real, dead_band_rad_s=0.0)
            self._responses = {
                False: MotorModel(self._real, physics.dt_s),
                True: MotorModel(torque, physics.dt_s),
            }
        self._is_effort = True
        self._values: Values = (0.0,) * len(WHEELS)
        self._response: MotorModel | None = None
        self._supplied = 1.0
        self._servo = False

    def command(self, command: WheelCommand, efforts: Sequence[float]) -> None:
        """Take a command from now on; `efforts` are the motors' last torques [N·m]."""
        limit = self._max_torque if command.is_effort else self._max_speed
        self._is_effort = command.is_effort
        self._values = tuple([min(max(value, -limit), limit) for value in command.values])
        self._use(servo=not (command.is_effort or self._pids))
        if self._real is not None:
            self._response = self._responses[command.is_effort]
            self._response.give(self._values)
            self._supplied = supply(self._real.sag_per_nm, efforts)
        elif self._servo:
            self._set(self._values)

    def step(self) -> None:
        """Set the commands of DART's joints for the next step."""
        if self._response is not None:
            values = self._response.step(self._supplied)
        elif self._servo:
            return
        else:
            values = self._values
        if self._servo:
            self._set(values)
            return
        speeds = [wheel.getVelocity(0) for wheel in self._wheels]
        if not self._is_effort:
            goals = zip(self._pids, values, speeds, strict=True)
            values = tuple([pid.update(goal - speed) for pid, goal, speed in goals])
        self._set([self._limited(*pair) for pair in zip(values, speeds, strict=True)])

    def torques(self) -> list[float]:
        """Return the torques of the motors in the last step [N·m]."""
        if self._servo:
            # DART's servo is a velocity constraint; its torque is that constraint's impulse.
            torques = [wheel.getConstraintImpulse(0) / self._dt for wheel in self._wheels]
        else:
            torques = [wheel.getCommand(0) for wheel in self._wheels]
        if self._real is None:
            return torques
        speeds = [wheel.getVelocity(0) for wheel in self._wheels]
        return [t + friction(self._real, s) for t, s in zip(torques, speeds, strict=True)]

    def _use(self, *, servo: bool) -> None:
        if servo != self._servo:
            self._servo = servo
            actuator = dart.dynamics.SERVO if servo else dart.dynamics.FORCE
            for wheel in self._wheels:
                wheel.setActuatorType(actuator)

    def _set(self, values: Sequence[float]) -> None:
        for wheel, value in zip(self._wheels, values, strict=True):
            wheel.setCommand(0, value)

    def _limited(self, torque: float, speed: float) -> float:
        """Return the torque at a wheel [N·m], within the motor's limits at its speed [rad/s]."""
        upper = self._max_torque if speed < self._max_speed else 0.0
        lower = -self._max_torque if speed > -self._max_speed else 0.0
        torque = min(max(torque, lower), upper)
        return torque if self._real is None else torque - friction(self._real, speed)


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
    """The response of the four wheels to their commands.

    Args:
        motors: Parameters of the motors.
        dt: Physics step [s].
    """

    def __init__(self, motors: RealMotors, dt: float) -> None:
        self._motors, self._dt = motors, dt
        self._steps = 0
        self._commands: deque[tuple[float, Values]] = deque()
        """Pending commands, with the times at which they arrive at the motors [s]."""
        self._newest: Values = (0.0,) * len(WHEELS)
        self._in_force = self._newest
        self._output = self._newest

    def give(self, command: Sequence[float]) -> None:
        """Take a command from now on: speeds [rad/s], or torques [N·m]."""
        values = tuple(command)
        if values != self._newest:
            self._newest = values
            self._commands.append((self._steps * self._dt + self._motors.delay_s, values))

    def step(self, supplied: float) -> Values:
        """Return the output at the end of the next step: speeds [rad/s], or torques [N·m].

        Args:
            supplied: Share of the supply voltage that remains under load.
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
        goal = self._shaped(self._in_force, supplied)
        lag = self._motors.time_constant_s
        left = math.exp(-duration / lag) if lag > 0.0 else float(duration == 0.0)
        self._output = tuple(
            aim + left * (value - aim) for aim, value in zip(goal, self._output, strict=True)
        )

    def _shaped(self, values: Values, supplied: float) -> Values:
        dead = self._motors.dead_band_rad_s
        return tuple(
            gain * supplied * math.copysign(max(abs(value) - dead, 0.0), value)
            for gain, value in zip(self._motors.gains, values, strict=True)
        )


def friction(motors: RealMotors, speed: float) -> float:
    """Return the friction torque of motor and gear [N·m] at a wheel's speed [rad/s]."""
    part = min(max(speed / STILL_RAD_S, -1.0), 1.0)
    return motors.coulomb_nm * part + motors.viscous_nms * speed


def supply(sag_per_nm: float, torques: Sequence[float]) -> float:
    """Return the share of the supply voltage that remains under the motors' torques [N·m]."""
    load = math.fsum(map(abs, torques))
    return max(1.0 - sag_per_nm * load, 0.0)
