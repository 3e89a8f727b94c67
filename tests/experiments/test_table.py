"""A run as columns, from the rows that it gave, and poses of many ticks against those of one."""

import math

import numpy as np
import pytest
from harness import load_robot
from hypothesis import given
from hypothesis import strategies as st
from mecazen import geometry, keys
from mecazen.bus import LocalBus
from mecazen.config import Scenario, SimConfig
from mecazen.geometry import Pose2D, Twist2D
from mecazen.messages import FollowerState, Time, Twist, planar_odometry
from mecazen.wire import Stamp
from mecazen_experiments.table import Poses, Table, wrap
from mecazen_tools.trajectory import COLUMNS, Trajectory

TICK_NS = 20_000_000
TICKS = 3


def trajectory(ticks=TICKS, services=("physics", "controller", "target", "follower")):
    """A run in which the follower knows the person in tick 1 alone."""
    bus = LocalBus()
    sim = SimConfig(tick_s=TICK_NS / 1e9, duration_s=ticks * TICK_NS / 1e9)
    trajectory = Trajectory(bus, Scenario(load_robot(), services, sim=sim))

    def put(topic, tick, message):
        bus.publisher(topic).put(message, Stamp(tick * TICK_NS, 1, 0))

    for tick in range(ticks):
        robot, person, odom = (
            planar_odometry(Time(), "", "", Pose2D(x, tick, 0.5), Twist2D(0.5, 0.25, 1.0))
            for x in (1.0, 2.0, 3.0)
        )
        known = tick == 1
        state = FollowerState(
            estimate=(odom,) if known else (), tracking="following" if known else "waiting"
        )
        put(keys.GROUND_TRUTH, tick, robot)
        put(keys.ODOM, tick, odom)
        put(keys.TARGET_ODOM, tick, person)
        put(keys.FOLLOWER_STATE, tick, state)
        put(keys.CMD_VEL, tick, Twist.planar(Twist2D(0.125, -0.5, tick)))
    return trajectory


def test_columns_hold_the_rows():
    table = Table.of(trajectory())
    assert len(table) == TICKS
    assert table["t_s"].tolist() == [0.0, 0.02, 0.04]
    assert table["robot_y_m"].tolist() == [0.0, 1.0, 2.0]
    assert table["cmd_yaw_rate_rad_s"].tolist() == [0.0, 1.0, 2.0]
    assert table.tracking.tolist() == ["waiting", "following", "waiting"]
    assert {table[name].dtype for name in COLUMNS if name != "tracking"} == {np.dtype(np.float64)}


def test_where_nothing_was_reported_there_is_nan_and_no_tracking():
    table = Table.of(trajectory())
    assert np.isnan(table["estimate_x_m"]).tolist() == [True, False, True]
    alone = Table.of(trajectory(services=("physics",)))
    assert np.isnan(alone["target_x_m"]).all()
    assert alone.tracking.tolist() == [""] * TICKS


def test_the_tick_is_the_time_from_row_to_row():
    assert Table.of(trajectory()).tick_s == 0.02
    assert np.isnan(Table.of(trajectory(ticks=1)).tick_s)


def test_poses_are_those_of_whom_is_named():
    table = Table.of(trajectory())
    assert table.poses("robot").at(2) == Pose2D(1.0, 2.0, pytest.approx(0.5))
    assert table.poses("target").at(1) == Pose2D(2.0, 1.0, pytest.approx(0.5))
    assert table.poses("odom").at(0) == Pose2D(3.0, 0.0, pytest.approx(0.5))


def test_where_takes_some_ticks_of_every_column():
    table = Table.of(trajectory())
    late = table.where(slice(1, None))
    assert late["t_s"].tolist() == [0.02, 0.04]
    assert late.tracking.tolist() == ["following", "waiting"]
    assert late.tick_s == table.tick_s
    known = table.where(~np.isnan(table["estimate_x_m"]))
    assert known["t_s"].tolist() == [0.02]


numbers = st.floats(-100.0, 100.0)
angles = st.floats(-math.pi, math.pi)
poses = st.builds(Pose2D, numbers, numbers, angles)
pairs = st.lists(st.tuples(poses, poses), min_size=1, max_size=5)
ROUNDING = 1e-12
"""A coordinate of up to 400 has a rounding of 6e-14; some of them add up."""


def many(of_one):
    return Poses(*np.array(of_one).T)


def assert_same(found, expected):
    for tick, pose in enumerate(expected):
        assert found.at(tick)[:2] == pytest.approx(pose[:2], abs=ROUNDING)
        assert geometry.wrap(found.at(tick).yaw - pose.yaw) == pytest.approx(0.0, abs=ROUNDING)


@given(pairs)
def test_compose_and_between_are_those_of_each_pose_and_of_one_for_all(pairs):
    left, right = zip(*pairs, strict=True)
    assert_same(many(left).compose(many(right)), [a.compose(b) for a, b in pairs])
    assert_same(many(left).between(many(right)), [a.between(b) for a, b in pairs])
    assert_same(many(left).compose(right[0]), [pose.compose(right[0]) for pose in left])


def test_wrap_brings_angles_to_between_minus_and_plus_half_a_turn():
    angles = wrap(np.radians([0.0, 179.0, 181.0, -181.0, 360.0, 730.0]))
    assert np.degrees(angles) == pytest.approx([0.0, 179.0, -179.0, 179.0, 0.0, 10.0], abs=1e-12)
