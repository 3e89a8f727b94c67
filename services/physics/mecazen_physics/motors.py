"""The wheels' motors: from commands of speed or torque to commands of DART's joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from mecazen.config import PhysicsConfig
from mecazen.config.services import Pid
from mecazen.robot import WHEELS, RealMotors, Robot
from mecazen.wheels import WheelCommand
from msgspec.structs import replace

from mecazen_physics.body import RobotBody
from mecazen_physics.motor_model import MotorModel, friction, supply
from mecazen_physics.state import RobotState

Push = Callable[[], object]
"""Sets the wheels' commands before a step."""


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


class Motors:
    """The four motors of a robot.

    Speeds and torques are clipped at the motor's limits, and a torque does not accelerate a wheel
    beyond its maximum speed. With a table `motors` in the robot file, the motors follow commands as
    real motors do, and friction is subtracted from the torque at a wheel.
    """

    def __init__(self, robot: Robot, physics: PhysicsConfig) -> None:
        self._max_torque = robot.wheels.max_torque_nm
        self._max_speed = robot.wheels.max_speed_rad_s
        self._pids: list[WheelPid] = []
        real = robot.motors if physics.motors == "robot" else None
        self._real = real
        self._speeds = self._torques = None
        if real is not None:
            self._speeds = MotorModel(real, physics.dt_s)
            self._torques = MotorModel(replace(real, dead_band_rad_s=0.0), physics.dt_s)
        if physics.drive == "effort":
            self._pids = [WheelPid(physics.pid, self._max_torque, physics.dt_s) for _ in WHEELS]

    def apply(self, command: WheelCommand, body: RobotBody, state: RobotState) -> Push | None:
        """Send a command to the motors of `body`.

        Returns:
            A function to call before each step, if needed.
        """
        if self._real is not None:
            return self._apply_real(self._real, command, body, state)
        if command.is_effort:
            body.use("torque")
            return partial(self._push, body.wheels, command.values)
        limit = self._max_speed
        target = [min(max(speed, -limit), limit) for speed in command.values]
        if self._pids:
            body.use("torque")
            return partial(self._control, body.wheels, target)
        body.use("servo")
        for wheel, speed in zip(body.wheels, target, strict=True):
            wheel.setCommand(0, speed)
        return None

    def _apply_real(
        self, real: RealMotors, command: WheelCommand, body: RobotBody, state: RobotState
    ) -> Push:
        """Send a command to real motors; see `apply`."""
        supplied, wheels = supply(real.sag_per_nm, state), body.wheels
        limit = self._max_torque if command.is_effort else self._max_speed
        motors = self._torques if command.is_effort else self._speeds
        assert motors is not None
        motors.give([min(max(value, -limit), limit) for value in command.values])
        if not command.is_effort and not self._pids:
            body.use("servo")

            def follow() -> None:
                for wheel, speed in zip(wheels, motors.step(supplied), strict=True):
                    wheel.setCommand(0, speed)

            return follow
        body.use("torque")

        def push() -> None:
            values = motors.step(supplied)
            if command.is_effort:
                self._push(wheels, values)
            else:
                self._control(wheels, values)

        return push

    def _control(self, wheels: Sequence[Any], target: Sequence[float]) -> None:
        """Set the torques that bring the wheels to the speeds `target` [rad/s]."""
        torques = [
            pid.update(goal - wheel.getVelocity(0))
            for pid, goal, wheel in zip(self._pids, target, wheels, strict=True)
        ]
        self._push(wheels, torques)

    def _push(self, wheels: Sequence[Any], torques: Sequence[float]) -> None:
        """Set the wheels' torques [N·m], within the motors' limits at the present speeds."""
        limit, fastest = self._max_torque, self._max_speed
        for wheel, torque in zip(wheels, torques, strict=True):
            speed = wheel.getVelocity(0)
            upper = limit if speed < fastest else 0.0
            lower = -limit if speed > -fastest else 0.0
            given = min(max(torque, lower), upper)
            wheel.setCommand(0, given - self.friction(speed))

    def friction(self, speed: float) -> float:
        """Return the torque that friction of motor and gear takes at a wheel's speed [rad/s]."""
        return 0.0 if self._real is None else friction(self._real, speed)
