"""Instruments measure the true state, with the errors that the configuration names."""

import math

import numpy as np
import pytest
from mecazen import messages as m
from mecazen.config.sensors import BatteryConfig, ImuConfig
from mecazen_physics.instruments import Battery, Imu
from mecazen_physics.state import RobotState

EXACT = ImuConfig(
    gyro_std_rad_s=0.0,
    gyro_bias_std_rad_s=0.0,
    gyro_walk_rad_s=0.0,
    accel_std_m_s2=0.0,
    accel_bias_std_m_s2=0.0,
    accel_walk_m_s2=0.0,
)
G = 9.80665
LEFT = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))
"""The orientation of a robot that looks along y of world."""


def moving(linear=(0.0, 0.0, 0.0), angular=(0.0, 0.0, 0.0), orientation=(0.0, 0.0, 0.0, 1.0)):
    return RobotState(0.0, (0.0, 0.0, 0.0), orientation, linear, angular, [], [], [])


def vector(xyz):
    return xyz.x, xyz.y, xyz.z


def test_imu_measures_sideways_acceleration_in_base_link():
    imu = Imu(EXACT, 2, 0.01, seed=1)
    sample = imu.measure(moving((0.0, 0.1, 0.0), orientation=LEFT), m.Time(2))
    # 0.1 m/s within two ticks of 10 ms
    assert vector(sample.linear_acceleration) == pytest.approx((0.0, 5.0, G))
    assert (sample.header.stamp, sample.header.frame_id) == (m.Time(2), "base_link")
    assert sample.orientation_covariance[0] == -1.0  # ROS's sign of no estimate


def test_imu_measures_centripetal_acceleration():
    imu, rate = Imu(EXACT, 1, 0.01, seed=1), 2.0
    for tick in range(2):
        yaw = rate * 0.01 * tick
        turned = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        sample = imu.measure(moving((0.5, 0.0, 0.0), (0.0, 0.0, rate), turned), m.Time())
    assert vector(sample.angular_velocity) == (0.0, 0.0, rate)
    # the mean of a tick, so half of its turn (0.01 rad) is off: 0.5·2·0.01 m/s²
    assert vector(sample.linear_acceleration) == pytest.approx((0.0, 1.0, G), abs=0.011)


def test_battery_sags_under_motor_load():
    battery = Battery(BatteryConfig(voltage_v=10.0), 0.05, 1, seed=1)
    loaded = moving()._replace(joint_effort=[1.0, -1.0, 0.5, -0.5])
    voltages = [battery.measure(loaded, m.Time()).voltage for _ in range(500)]
    assert np.mean(voltages) == pytest.approx(8.5, abs=5 * 0.02 / math.sqrt(500))
    assert np.std(voltages) == pytest.approx(0.02, rel=0.16)  # 500 values: 3.2 %; five of those
    assert voltages[0] == float(np.float32(voltages[0]))  # exact in ROS's 32 bits
