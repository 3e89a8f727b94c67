"""The PID by hand, what its anti-windup is for, and the controller of three."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.config.follower import PidControl
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen_follower.pid import PID, Gains, PoseController

DT = 0.01


def test_terms_add_up_as_computed_by_hand():
    pid = PID(Gains(kp=2.0, ki=0.5, kd=0.1, limit=10.0))
    # 0.3 + 2 * 1 + 0.5 * 1 * 0.2 + 0.1 * -4
    assert pid.update(1.0, -4.0, 0.2, 0.3) == pytest.approx(2.0)
    # the integral alone is left: 0.1
    assert pid.update(0.0, 0.0, 0.2) == pytest.approx(0.1)


def test_integral_does_not_wind_up_at_the_limit():
    pid = PID(Gains(kp=1.0, ki=1.0, limit=0.5))
    for _ in range(1000):
        assert pid.update(2.0, 0.0, DT) == 0.5
    # With 20 s·m of integral it would stay at its limit for long; it turns at once.
    assert pid.update(-0.1, 0.0, DT) == pytest.approx(-0.101)


def test_integral_is_unwound_while_the_output_is_at_its_limit():
    pid = PID(Gains(kp=0.0, ki=1.0, limit=1.0))
    pid.update(0.9, 0.0, 1.0)
    for _ in range(10):
        # The feed-forward alone holds the output at its limit; the error is against it.
        assert pid.update(-0.05, 0.0, 1.0, feed_forward=5.0) == 1.0
    assert pid.update(0.0, 0.0, 1.0) == pytest.approx(0.4)


def test_integral_removes_the_steady_error_of_a_constant_disturbance():
    pid, position = PID(Gains(kp=2.0, ki=1.0, limit=5.0)), 0.0
    for _ in range(3000):
        position += (pid.update(1.0 - position, 0.0, DT) - 0.3) * DT
    # e^-t decides: 30 s leave less than 1e-10.
    assert position == pytest.approx(1.0, abs=1e-6)


finite = st.floats(-1e6, 1e6)


@given(st.lists(st.tuples(finite, finite, finite), min_size=1, max_size=30))
def test_output_is_always_finite_and_within_the_limit(inputs):
    pid = PID(Gains(kp=3.0, ki=2.0, kd=0.5, limit=1.5))
    for error, rate, feed_forward in inputs:
        output = pid.update(error, rate, DT, feed_forward)
        assert math.isfinite(output)
        assert abs(output) <= 1.5


NORTH = math.pi / 2


def controller(kp=1.0, ki=0.0, kd=0.0, feed_forward=True):
    gains = Gains(kp=kp, ki=ki, kd=kd, limit=5.0)
    return PoseController(PidControl(gains, gains, gains, feed_forward))


def test_error_is_taken_in_base_link():
    # The robot looks along +y; a goal 1 m to the +x is on its right.
    twist = controller().command(Pose2D(1.0, 0.0, NORTH), Twist2D(), Pose2D(0.0, 0.0, NORTH), DT)
    assert twist == pytest.approx((0.0, -1.0, 0.0), abs=1e-12)


def test_feed_forward_is_turned_into_base_link():
    here = Pose2D(3.0, 4.0, NORTH)
    twist = controller().command(here, Twist2D(0.2, 0.5, 0.1), here, DT)
    assert twist == pytest.approx((0.5, -0.2, 0.1))


def test_without_feed_forward_the_goal_velocity_does_nothing():
    here = Pose2D(3.0, 4.0, 1.0)
    twist = controller(kd=1.0, feed_forward=False).command(here, Twist2D(1.0, 1.0, 1.0), here, DT)
    assert twist == Twist2D()


def test_heading_takes_the_short_way_across_the_wrap():
    twist = controller().command(Pose2D(0.0, 0.0, -3.1), Twist2D(), Pose2D(0.0, 0.0, 3.1), DT)
    assert twist.yaw == pytest.approx(math.tau - 6.2)


@pytest.mark.parametrize(
    ("goals", "robots", "expected"),
    [
        # a goal that jumps 0.004 m ahead in 0.01 s: 0.5 * 0.4 m/s
        ([Pose2D(), Pose2D(0.004)], [Pose2D(), Pose2D()], (0.2, 0.0, 0.0)),
        # the robot looks along +y and moves 0.004 m ahead: the error falls
        ([Pose2D()] * 2, [Pose2D(0.0, 0.0, NORTH), Pose2D(0.0, 0.004, NORTH)], (-0.2, 0.0, 0.0)),
        # 1 m ahead of a robot that turns left by 0.001: the goal moves 0.001 m to the right
        ([Pose2D(1.0)] * 2, [Pose2D(), Pose2D(0.0, 0.0, 0.001)], (0.0, -0.05, -0.05)),
        # 0.002 rad to the left, across the wrap of the error at pi
        (
            [Pose2D(0.0, 0.0, math.pi - 0.001), Pose2D(0.0, 0.0, 0.001 - math.pi)],
            [Pose2D(), Pose2D()],
            (0.0, 0.0, 0.1),
        ),
        # the robot moves with the goal: the error is constant
        ([Pose2D(1.0), Pose2D(1.004)], [Pose2D(), Pose2D(0.004)], (0.0, 0.0, 0.0)),
    ],
    ids=["jump", "ahead", "turn", "wrap", "together"],
)
def test_derivative_is_the_rate_of_the_error(goals, robots, expected):
    control = controller(kp=0.0, kd=0.5, feed_forward=False)
    for goal, robot in zip(goals, robots, strict=True):
        twist = control.command(goal, Twist2D(), robot, DT)
    # 5e-7 is the second order of the turn, times 0.5 / 0.01 s
    assert twist == pytest.approx(expected, abs=3e-5)


def test_stop_is_at_rest_and_forgets_integrals_and_motion():
    control = controller(kp=0.0, ki=1.0, kd=1.0)
    for tick in range(100):
        control.command(Pose2D(5.0, 5.0, 1.0), Twist2D(), Pose2D(tick * DT, 0.0, 0.0), DT)
    assert control.stop() == Twist2D()
    here = Pose2D(9.0, 9.0, 0.0)
    assert control.command(here, Twist2D(), here, DT) == Twist2D()


coordinates = st.floats(-10.0, 10.0)
poses = st.builds(Pose2D, coordinates, coordinates, st.floats(-math.pi, math.pi))


@given(poses, poses)
def test_from_anywhere_a_resting_goal_is_reached(goal, robot):
    control = controller(kp=2.0)
    for _ in range(1500):
        robot = robot.integrate(control.command(goal, Twist2D(), robot, DT), DT)
    # 30 m at 5 m/s, then 9 s at e^-2t: below 1e-6.
    assert robot.distance(goal) < 1e-5
    assert abs(wrap(robot.yaw - goal.yaw)) < 1e-5
