"""On-board instruments: from the state of the robot to measurements."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from mecazen import messages as m
from mecazen.config.sensors import BatteryConfig, EncodersConfig, ImuConfig
from mecazen.robot import WHEELS
from numpy.random import PCG64, Generator

from mecazen_physics.motors import supply
from mecazen_physics.state import RobotState, Vector, unrotate
from mecazen_physics.world import GRAVITY

NOT_MEASURED = (-1.0, *(0.0,) * 8)
"""ROS's covariance of a quantity that a sensor does not measure."""


class Imu:
    """An inertial measurement unit with white noise and a random-walk bias; `period` in ticks."""

    def __init__(self, config: ImuConfig, period: int, tick_s: float, seed: int) -> None:
        self.period = period
        self._period_s = period * tick_s
        self._velocity: Vector = (0.0, 0.0, 0.0)
        """Velocity in world at the last sample [m/s]."""
        self._random = Generator(PCG64((seed, 1)))
        # of angular velocity and force
        self._std = np.array(((config.gyro_std_rad_s,), (config.accel_std_m_s2,)))
        walk = np.array(((config.gyro_walk_rad_s,), (config.accel_walk_m_s2,)))
        self._walk = walk * math.sqrt(self._period_s)
        bias = np.array(((config.gyro_bias_std_rad_s,), (config.accel_bias_std_m_s2,)))
        self._bias = bias * self._random.standard_normal((2, 3))

    def measure(self, state: RobotState, time: m.Time) -> m.Imu:
        """Return the sample of a state; call it once in each period."""
        x, y, z, w = state.orientation
        velocity = unrotate((-x, -y, -z, w), *state.linear)  # in world
        change = [
            (new - old) / self._period_s for new, old in zip(velocity, self._velocity, strict=True)
        ]
        self._velocity = velocity
        force = unrotate(state.orientation, change[0], change[1], change[2] + GRAVITY)
        noise = self._random.standard_normal((2, 2, 3))
        self._bias += self._walk * noise[:, 0]
        measured = np.array((state.angular, force)) + self._bias + self._std * noise[:, 1]
        angular, linear = measured.tolist()
        variances = (self._std**2 * np.eye(3).ravel()).tolist()
        return m.Imu(
            header=m.Header(stamp=time, frame_id="base_link"),
            orientation_covariance=NOT_MEASURED,
            angular_velocity=m.Vector3(*angular),
            angular_velocity_covariance=tuple(variances[0]),
            linear_acceleration=m.Vector3(*linear),
            linear_acceleration_covariance=tuple(variances[1]),
        )


class Encoders:
    """The encoders of the wheels, with some counts per turn: counts, and their change per tick."""

    def __init__(self, config: EncodersConfig, tick_s: float) -> None:
        self._step = 2.0 * math.pi / config.counts_per_turn
        self._tick_s = tick_s
        self._last: tuple[int, ...] | None = None

    def measure(self, positions: Sequence[float]) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return positions [rad] and velocities [rad/s] of the wheels; call it in each tick."""
        counts = tuple(math.floor(position / self._step) for position in positions)
        last, self._last = self._last or counts, counts
        changes = (new - old for new, old in zip(counts, last, strict=True))
        return (
            tuple(count * self._step for count in counts),
            tuple(change * self._step / self._tick_s for change in changes),
        )


class Battery:
    """The battery, whose voltage is measured with noise; `period` in ticks.

    Each N·m of the motors' summed torques costs the share `sag_per_nm` of the voltage.
    """

    def __init__(self, config: BatteryConfig, sag_per_nm: float, period: int, seed: int) -> None:
        self.period = period
        self._sag_per_nm = sag_per_nm
        self._config = config
        self._random = Generator(PCG64((seed, 2)))

    def measure(self, state: RobotState, time: m.Time) -> m.BatteryState:
        """Return the sample of a state; call it once in each period."""
        config = self._config
        noise = config.voltage_std_v * float(self._random.standard_normal())
        voltage = (
            config.voltage_v * supply(self._sag_per_nm, state.joint_effort[: len(WHEELS)]) + noise
        )
        return m.BatteryState(
            header=m.Header(stamp=time, frame_id="base_link"),
            voltage=float(np.float32(voltage)),
            present=True,
        )
