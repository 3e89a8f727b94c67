"""The pose controller: frames, feed-forward, derivative, wrap."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.geometry import Pose2D, Twist2D, rotate, wrap
from mecazen_follower.pid import Gains, PoseController

DT = 0.01
NORTH = math.pi / 2


def make(kp=1.0, ki=0.0, kd=0.0, feed_forward=True):
    gains = Gains(kp=kp, ki=ki, kd=kd, limit=5.0)
    return PoseController(gains, gains, gains, feed_forward)


def test_error_is_taken_in_base_link():
    # The robot looks along +y; a goal 1 m to the +x is on its right.
    twist = make().command(Pose2D(1.0, 0.0, NORTH), Twist2D(), Pose2D(0.0, 0.0, NORTH), DT)
    assert twist == pytest.approx((0.0, -1.0, 0.0), abs=1e-12)


def test_feed_forward_is_turned_into_base_link():
    here = Pose2D(3.0, 4.0, NORTH)
    twist = make().command(here, Twist2D(0.2, 0.5, 0.1), here, DT)
    assert twist == pytest.approx((0.5, -0.2, 0.1))


def test_without_feed_forward_the_goal_velocity_does_nothing():
    here = Pose2D(3.0, 4.0, 1.0)
    twist = make(kd=1.0, feed_forward=False).command(here, Twist2D(1.0, 1.0, 1.0), here, DT)
    assert twist == Twist2D()


def test_heading_takes_the_short_way_across_the_wrap():
    twist = make().command(Pose2D(0.0, 0.0, -3.1), Twist2D(), Pose2D(0.0, 0.0, 3.1), DT)
    assert twist.yaw == pytest.approx(math.tau - 6.2)


def test_derivative_damps_the_robots_own_motion_in_base_link():
    control = make(kp=0.0, kd=0.5, feed_forward=False)
    goal = Pose2D()
    assert control.command(goal, Twist2D(), Pose2D(0.0, 0.0, NORTH), DT) == Twist2D()
    # 0.4 m/s forward (+y), and across the wrap nothing special.
    twist = control.command(goal, Twist2D(), Pose2D(0.0, 0.004, NORTH), DT)
    assert twist == pytest.approx((-0.2, 0.0, 0.0), abs=1e-12)


def test_derivative_of_the_heading_wraps():
    control = make(kp=0.0, kd=0.5, feed_forward=False)
    control.command(Pose2D(), Twist2D(), Pose2D(0.0, 0.0, math.pi - 0.001), DT)
    twist = control.command(Pose2D(), Twist2D(), Pose2D(0.0, 0.0, -math.pi + 0.001), DT)
    assert twist.yaw == pytest.approx(-0.1)


def test_with_feed_forward_the_derivative_does_not_oppose_moving_with_the_goal():
    control = make(kd=2.0)
    velocity = Twist2D(0.6, 0.8, 0.0)
    for tick in range(5):
        pose = Pose2D(0.6 * tick * DT, 0.8 * tick * DT, 0.3)
        twist = control.command(pose, velocity, pose, DT)
    assert rotate(twist.x, twist.y, 0.3) == pytest.approx((0.6, 0.8))


def test_a_goal_that_jumps_gives_no_derivative_kick():
    control = make(kd=5.0)
    robot = Pose2D()
    control.command(robot, Twist2D(), robot, DT)
    assert control.command(Pose2D(0.1, 0.0, 0.0), Twist2D(), robot, DT).x == pytest.approx(0.1)


def test_stop_is_at_rest_and_forgets_integrals_and_motion():
    control = make(kp=0.0, ki=1.0, kd=1.0)
    for tick in range(100):
        control.command(Pose2D(5.0, 5.0, 1.0), Twist2D(), Pose2D(tick * DT, 0.0, 0.0), DT)
    assert control.stop() == Twist2D()
    here = Pose2D(9.0, 9.0, 0.0)
    assert control.command(here, Twist2D(), here, DT) == Twist2D()


coordinates = st.floats(-10.0, 10.0)
poses = st.builds(Pose2D, coordinates, coordinates, st.floats(-math.pi, math.pi))


@given(poses, poses)
def test_from_anywhere_a_resting_goal_is_reached(goal, robot):
    control = make(kp=2.0)
    for _ in range(1500):
        robot = robot.integrate(control.command(goal, Twist2D(), robot, DT), DT)
    # 30 m at 5 m/s, then 9 s at e^-2t: below 1e-6.
    assert robot.distance(goal) < 1e-5
    assert abs(wrap(robot.yaw - goal.yaw)) < 1e-5
