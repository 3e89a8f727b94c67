"""Model of real motors: delay, dead band, gain and lag of commands, friction, supply voltage."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

from mecazen.robot import WHEELS, RealMotors

from mecazen_physics.state import RobotState

STILL_RAD_S = 0.02
"""Below this speed Coulomb friction grows with speed, so that it does not flip its sign at rest."""
Speeds = tuple[float, ...]


class MotorModel:
    """The response of the four wheels to their commands.

    Args:
        motors: Parameters of the motors.
        dt: Physics step [s].
    """

    def __init__(self, motors: RealMotors, dt: float) -> None:
        self._motors, self._dt = motors, dt
        self._steps = 0
        self._commands: deque[tuple[float, Speeds]] = deque()
        """Pending commands, with the times at which they arrive at the motors [s]."""
        self._newest: Speeds = (0.0,) * len(WHEELS)
        self._in_force = self._newest
        self._output = self._newest

    def give(self, command: Sequence[float]) -> None:
        """Take a command from now on: speeds [rad/s], or torques [N·m]."""
        values = tuple(command)
        if values != self._newest:
            self._newest = values
            self._commands.append((self._steps * self._dt + self._motors.delay_s, values))

    def step(self, supplied: float) -> Speeds:
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

    def _shaped(self, values: Speeds, supplied: float) -> Speeds:
        dead = self._motors.dead_band_rad_s
        return tuple(
            gain * supplied * math.copysign(max(abs(value) - dead, 0.0), value)
            for gain, value in zip(self._motors.gains, values, strict=True)
        )


def friction(motors: RealMotors, speed: float) -> float:
    """Return the friction torque of motor and gear [N·m] at a wheel's speed [rad/s]."""
    part = min(max(speed / STILL_RAD_S, -1.0), 1.0)
    return motors.coulomb_nm * part + motors.viscous_nms * speed


def supply(sag_per_nm: float, state: RobotState) -> float:
    """Return the share of the supply voltage that remains under the load of the motors."""
    load = math.fsum(abs(torque) for torque in state.joint_effort[: len(WHEELS)])
    return max(1.0 - sag_per_nm * load, 0.0)
