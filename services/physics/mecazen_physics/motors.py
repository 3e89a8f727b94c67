"""The wheels' motors: from commands of speed or torque to commands of DART's joints."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from operator import sub
from typing import Any

from mecazen.config import PhysicsConfig
from mecazen.config.services import Pid
from mecazen.links import robot_links
from mecazen.robot import WHEELS, RealMotors, Robot
from mecazen.wheels import WheelCommand
from msgspec.structs import replace

from mecazen_physics import model
from mecazen_physics.body import RobotBody
from mecazen_physics.motor_model import MotorModel, friction, supply
from mecazen_physics.state import RobotState

TORQUE_HEADROOM = 0.8
"""Motors that need less than this share of their maximum torque are simulated without the limit."""

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
        self._dt = physics.dt_s
        self._max_torque = robot.wheels.max_torque_nm
        self._max_speed = robot.wheels.max_speed_rad_s
        self._hub_inertia = robot_links(robot)[0].moments[1]
        self._torque_per_change = model.driven_inertia(robot) / physics.dt_s
        """Torque [N·m] for each rad/s by which a wheel's speed changes in one step."""
        self._pids: list[WheelPid] = []
        real = robot.motors if physics.motors == "robot" else None
        self._real = real
        self._speeds = self._torques = None
        if real is not None:
            self._speeds = MotorModel(real, physics.dt_s)
            self._torques = MotorModel(replace(real, dead_band_rad_s=0.0), physics.dt_s)
        if physics.drive == "effort":
            self._pids = [WheelPid(physics.pid, self._max_torque, physics.dt_s) for _ in WHEELS]

    def apply(
        self,
        command: WheelCommand,
        body: RobotBody,
        state: RobotState,
        steps: int,
        *,
        strict: bool,
    ) -> tuple[list[tuple[float, float]], Push | None]:
        """Send a command to the motors of `body` for the next `steps` steps.

        If not `strict`, motors with headroom are simulated without their torque limit.

        Returns:
            The lowest and the highest speed of each wheel in these steps [rad/s], and a function to
            call before each step, if needed.
        """
        speeds = state.joint_velocity[: len(WHEELS)]
        if self._real is not None:
            return self._apply_real(self._real, command, body, state, steps)
        if command.is_effort:
            gain = steps * self._dt / self._hub_inertia
            changes = [gain * min(abs(torque), self._max_torque) for torque in command.values]
            ranges = [(s - change, s + change) for s, change in zip(speeds, changes, strict=True)]
            body.use("torque")
            return ranges, partial(self._push, body.wheels, command.values)
        limit = self._max_speed
        target = [min(max(speed, -limit), limit) for speed in command.values]
        ranges = [(min(pair), max(pair)) for pair in zip(speeds, target, strict=True)]
        if self._pids:
            body.use("torque")
            return ranges, partial(self._control, body.wheels, target)
        rise = math.inf if strict else self._steps_within_headroom(target, state)
        body.use("speed" if rise <= steps else "servo")
        if 1.0 < rise <= steps:
            ramp = _ramp(body.wheels, speeds, target, math.ceil(rise))
            return ranges, partial(next, ramp, None)
        for wheel, speed in zip(body.wheels, target, strict=True):
            wheel.setCommand(0, speed)
        return ranges, None

    def _apply_real(
        self,
        real: RealMotors,
        command: WheelCommand,
        body: RobotBody,
        state: RobotState,
        steps: int,
    ) -> tuple[list[tuple[float, float]], Push]:
        """Send a command to real motors; see `apply`."""
        supplied = supply(real.sag_per_nm, state)
        speeds, wheels = state.joint_velocity[: len(WHEELS)], body.wheels
        limit = self._max_torque if command.is_effort else self._max_speed
        motors = self._torques if command.is_effort else self._speeds
        assert motors is not None
        motors.give([min(max(value, -limit), limit) for value in command.values])
        bounds = motors.bounds()
        if command.is_effort:
            gain = steps * self._dt / self._hub_inertia
            changes = [gain * max(-low, high) for low, high in bounds]
            ranges = [(s - change, s + change) for s, change in zip(speeds, changes, strict=True)]
        else:
            ranges = [
                (min(s, low), max(s, high)) for s, (low, high) in zip(speeds, bounds, strict=True)
            ]
        if not command.is_effort and not self._pids:
            body.use("servo")

            def follow() -> None:
                for wheel, speed in zip(wheels, motors.step(supplied), strict=True):
                    wheel.setCommand(0, speed)

            return ranges, follow
        body.use("torque")

        def push() -> None:
            values = motors.step(supplied)
            if command.is_effort:
                self._push(wheels, values)
            else:
                self._control(wheels, values)

        return ranges, push

    def _steps_within_headroom(self, target: Sequence[float], state: RobotState) -> float:
        """Return the number of steps in which the headroom allows to reach `target` [rad/s]."""
        if state.time == 0.0:
            return math.inf  # the first torque is not known yet
        efforts, speeds = state.joint_effort[: len(WHEELS)], state.joint_velocity
        left = TORQUE_HEADROOM * self._max_torque - max(map(abs, efforts))
        if left <= 0.0:
            return math.inf
        change: float = max(map(abs, map(sub, target, speeds)))
        return self._torque_per_change * change / left

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


def _ramp(
    wheels: Sequence[Any], speeds: Sequence[float], target: Sequence[float], steps: int
) -> Iterator[None]:
    """Bring wheels from `speeds` to `target` [rad/s] in `steps` equal steps, one at each `next`."""
    for step in range(1, steps + 1):
        part = step / steps
        for wheel, begin, end in zip(wheels, speeds, target, strict=True):
            wheel.setCommand(0, begin + part * (end - begin))
        yield
