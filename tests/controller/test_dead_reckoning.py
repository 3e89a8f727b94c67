"""Odometry in closed form."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.geometry import Twist2D
from mecazen_controller.dead_reckoning import DeadReckoning


def test_straight_and_sideways_add_up():
    odometry = DeadReckoning()
    odometry.update(Twist2D(0.5, 0.0, 0.0), 2.0)
    assert odometry.update(Twist2D(0.0, 0.25, 0.0), 2.0) == pytest.approx((1.0, 0.5, 0.0))
    assert odometry.twist == (0.0, 0.25, 0.0)


def test_heading_wraps():
    odometry = DeadReckoning()
    odometry.update(Twist2D(0.0, 0.0, 1.0), 4.0)
    assert odometry.pose.yaw == pytest.approx(4.0 - math.tau)


def test_scale_calibrates_each_axis():
    odometry = DeadReckoning(Twist2D(1.01, 0.98, 0.5))
    odometry.update(Twist2D(1.0, 1.0, 0.0), 1.0)
    assert odometry.pose == pytest.approx((1.01, 0.98, 0.0))
    odometry.update(Twist2D(0.0, 0.0, 1.0), 1.0)
    assert odometry.pose.yaw == pytest.approx(0.5)
    assert odometry.twist == (0.0, 0.0, 0.5)


velocity = st.floats(-5.0, 5.0)


@given(velocity, velocity, velocity)
def test_the_way_back_ends_where_it_began(x, y, yaw):
    odometry = DeadReckoning()
    odometry.update(Twist2D(x, y, yaw), 0.3)
    odometry.update(Twist2D(-x, -y, -yaw), 0.3)
    assert odometry.pose == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
