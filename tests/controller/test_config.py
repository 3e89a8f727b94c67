"""The controller's configuration: defaults, fallbacks, and what is refused."""

import math
from types import SimpleNamespace

import msgspec
import pytest
from mecazen.config import ControllerConfig
from mecazen.config.services import OdometryScale
from mecazen.drive import Limits, axis_limits
from mecazen.wheels import MecanumKinematics

ROBOT = SimpleNamespace(
    cross_gain=1.0, wheels=SimpleNamespace(radius_m=0.05), half_wheelbase=0.15, half_track=0.1
)


def load(**table):
    return msgspec.convert(table, ControllerConfig)


def test_defaults_are_those_a_ros_user_expects():
    config = load()
    assert (config.command_key, config.odometry_key) == ("cmd_vel", "odom")
    assert (config.odom_frame_id, config.base_frame_id) == ("odom", "base_link")
    assert config.odometry_scale == OdometryScale(1.0, 1.0, 1.0)


def test_lengths_come_from_the_robot_unless_given():
    assert MecanumKinematics.from_robot(ROBOT, load()) == MecanumKinematics(0.05, 0.15, 0.1)
    assert MecanumKinematics.from_robot(ROBOT, load(half_track_m=0.2)) == MecanumKinematics(
        0.05, 0.15, 0.2
    )


def test_limits_per_axis_default_deceleration_to_acceleration_and_jerk_to_none():
    config = load(
        limits={
            "x": {"max_deceleration_m_s2": 4.0},
            "y": {"max_velocity_m_s": math.inf, "max_jerk_m_s3": 9.0},
        }
    )
    x, y, yaw = axis_limits(config.limits)
    assert x == Limits(2.0, 2.5, 4.0, math.inf)
    assert y == Limits(math.inf, 2.5, 2.5, 9.0)
    assert yaw == Limits(3.0, 8.0, 8.0, math.inf)


def test_effective_configuration_loads_to_the_same():
    config = load(limits={"yaw": {"max_velocity_rad_s": math.inf}}, update_rate_hz=50.0)
    assert msgspec.convert(msgspec.to_builtins(config), ControllerConfig) == config


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"command_key": "/cmd_vel"}, "command_key"),
        ({"command_key": "robot/*"}, "command_key"),
        ({"odometry": "imu"}, "odometry"),
        ({"odom_frame_id": "base_link"}, "must differ from base_frame_id"),
        ({"odom_frame_id": "a", "base_frame_id": "a"}, "must differ from base_frame_id"),
        ({"limits": {"x": {"max_velocity_m_s": 0.0}}}, "max_velocity_m_s"),
        ({"limits": {"yaw": {"max_velocity_rad_s": math.nan}}}, "max_velocity_rad_s"),
        ({"limits": {"x": {"max_velocity_rad_s": 1.0}}}, "unknown field"),
        ({"reference_timeout_s": 0.0}, "reference_timeout_s"),
        ({"pose_covariance_diagonal": [1.0] * 5}, "pose_covariance_diagonal"),
        ({"odometry_scale": {"y": -1.0}}, "odometry_scale"),
    ],
)
def test_what_is_wrong_is_refused_and_named(table, message):
    with pytest.raises(msgspec.ValidationError, match=message):
        load(**table)
