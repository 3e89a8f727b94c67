"""The control laws: the polar law, the allocation of speed, and the PIDs."""

import math

import numpy as np
import pytest
from follower.rooms import DRIVE
from hypothesis import assume, example, given
from hypothesis import strategies as st
from mecazen.config import FollowerConfig
from mecazen.config.follower import Gains, PidControl, PolarControl
from mecazen.drive import Drive, Limits
from mecazen.geometry import Pose2D, Standoff, Twist2D, rotate
from mecazen_follower.control import (
    ALL_AROUND,
    PID,
    PolarController,
    PolarTwist,
    PoseController,
    allocate,
    approach,
    kept_view,
)
from planar import angles, poses, standoffs, twists

DT = 0.01
BACK = Standoff(1.0, math.pi, 0.0)
PERSON = Pose2D()
STILL = Twist2D()


def make(standoff=BACK, max_speed=2.0, max_yaw_rate=3.0):
    law = PolarControl(
        heading_gain_1_s=4.0, max_speed_m_s=max_speed, max_yaw_rate_rad_s=max_yaw_rate
    )
    return PolarController(standoff, law, Drive())


def follow(controller, robot, seconds, walk=STILL, standoff=BACK, acceleration=math.inf):
    """Yield person and robot, who takes commands with a limited linear acceleration [m/s²].

    The person starts at the origin and walks with a constant body twist.
    """
    person, moving = PERSON, Twist2D()
    change = acceleration * DT
    for _ in range(round(seconds / DT)):
        velocity = Twist2D(*rotate(walk.x, walk.y, person.yaw), walk.yaw)
        goal = standoff.goal(person)
        goal_velocity = standoff.goal_velocity(person, velocity)
        wanted = controller.command(goal, goal_velocity, robot, DT)
        moving = Twist2D(
            min(max(wanted.x, moving.x - change), moving.x + change),
            min(max(wanted.y, moving.y - change), moving.y + change),
            wanted.yaw,
        )
        robot = robot.integrate(moving, DT)
        person = person.integrate(walk, DT)
        yield person, robot


def test_approach_is_proportional_near_and_brakes_in_time_from_afar():
    # from afar v² = 2 * 2 m/s² * 4 m
    for error, rate in ((0.1, 0.3), (-0.1, -0.3), (4.0, 4.0), (0.0, 0.0)):
        assert approach(error, 3.0, 2.0) == pytest.approx(rate)


@given(standoffs, poses, twists)
def test_at_the_goal_it_moves_exactly_with_the_goal(standoff, person, velocity):
    goal = standoff.goal(person)
    goal_velocity = standoff.goal_velocity(person, velocity)
    # beyond the limits nothing would be exact: 5 m/s each way, and 5 rad/s times 10 m
    twist = make(standoff, 60.0, 10.0).command(goal, goal_velocity, goal, DT)
    wanted = (*rotate(goal_velocity.x, goal_velocity.y, -goal.yaw), goal_velocity.yaw)
    assert twist == pytest.approx(wanted, abs=1e-9)


@given(st.floats(1.0, 3.0), angles, angles)
@example(2.0, 0.0, math.pi)
def test_from_all_sides_it_comes_to_the_goal_and_never_near_the_person(distance, bearing, yaw):
    start = Pose2D(distance * math.cos(bearing), distance * math.sin(bearing), yaw)
    for person, robot in follow(make(), start, 8.0):
        assert person.distance(robot) > 0.8
    # half a circle at 2 m/s takes 1.6 s; then e^-3t
    assert robot == pytest.approx(BACK.goal(PERSON), abs=1e-3)


huge = st.floats(-1e6, 1e6)
anywhere = st.builds(Pose2D, huge, huge, angles)
any_twist = st.builds(Twist2D, huge, huge, huge)


@given(standoffs, anywhere, any_twist, anywhere)
def test_limits_hold_whatever_comes(standoff, goal, goal_velocity, robot):
    twist = make(standoff, 1.5, 2.5).command(goal, goal_velocity, robot, DT)
    # a vector of just that length, put together from its parts, is rounded a few times
    assert math.hypot(twist.x, twist.y) <= 1.5 * (1.0 + 1e-12)
    assert abs(twist.yaw) <= 2.5


@pytest.mark.parametrize("turn", [3.0, -3.0])
def test_the_distance_is_kept_from_a_person_who_spins_faster_than_the_robot_can_go(turn):
    start = BACK.goal(PERSON)
    way = list(follow(make(), start, 10.0, Twist2D(yaw=turn), acceleration=2.5))
    bearings = [BACK.errors(person, robot).bearing for person, robot in way]
    assert max(map(abs, bearings)) > 1.0  # 3 m/s would be needed, and 2 m/s there are
    # The goal laps the robot, which then has to turn back from 2 m/s: 0.8 s at 2.5 m/s².
    # Until then it is anywhere around the person; three PIDs would cut through them: 1 m.
    distances = [abs(person.distance(robot) - 1.0) for person, robot in way]
    assert max(distances) < 0.3
    assert np.mean(distances) < 0.1  # a tenth of the distance to keep, most of it at such turns


@pytest.mark.parametrize("distance", [1.5, 3.0, 10.0])
def test_a_robot_that_brakes_as_told_does_not_pass_its_distance(distance):
    way = follow(make(), Pose2D(-distance), 10.0, acceleration=2.5)
    distances = [person.distance(robot) for person, robot in way]
    # where braking turns into the exponential, and one tick: 2 m/s² * 0.01 s / 3 per s
    assert min(distances) > 1.0 - 0.007
    assert distances[-1] == pytest.approx(1.0, abs=1e-6)


def walk(config, walking, seconds, view=ALL_AROUND):
    """Yield person and robot, which starts at rest in its place and does what is commanded.

    The person's body twist at a time is `walking`; the follower knows pose and velocity.
    """
    controller = PolarController(config.standoff, config.control, DRIVE, view)
    person = Pose2D()
    robot = config.standoff.goal(person)
    for tick in range(round(seconds / DT)):
        twist = walking(tick * DT)
        velocity = Twist2D(*rotate(twist.x, twist.y, person.yaw), twist.yaw)
        goal_velocity = config.standoff.goal_velocity(person, velocity)
        command = controller.command(config.standoff.goal(person), goal_velocity, robot, DT)
        robot = robot.integrate(command, DT)
        person = person.integrate(twist, DT)
        yield person, robot


def distance_errors(config, walking, seconds):
    steps = walk(config, walking, seconds)
    return [abs(person.distance(robot) - config.standoff_m) for person, robot in steps]


def test_at_45_degrees_it_keeps_the_distance_from_who_is_faster_than_the_diagonal():
    # Diagonally the wheels reach 1.41 m/s: at that heading the robot would fall behind for ever.
    config = FollowerConfig(bearing_deg=135.0, heading_deg=-45.0)
    errors = distance_errors(config, lambda _: Twist2D(1.6), 15.0)
    assert max(errors[round(8.0 / DT) :]) < 0.01


@pytest.mark.parametrize("view", ["back", "front"])
def test_it_catches_up_with_who_walks_from_the_first_tick_nearly_as_fast_as_can_be(view):
    """The time-optimal plan: 2.5 m/s² up to 2 m/s, there until it has to brake to 1.3 m/s."""
    v, a, most = 1.3, 2.5, 2.0
    best, gap, speed = 0.0, 0.0, 0.0
    while speed < v or gap > 0.0:
        brakes = (speed - v) ** 2 / (2 * a) >= gap and speed > v
        speed = speed - a * DT if brakes else min(speed + a * DT, most)
        gap += (v - speed) * DT
        best += abs(gap) * DT
    config = FollowerConfig(view=view)
    area = sum(distance_errors(config, lambda _: Twist2D(v), 8.0)) * DT
    # besides, the last 0.2 m are taken at the gain of 3 per s that the noise allows
    assert area < best + 0.2 / 3.0


@pytest.mark.parametrize("view", ["back", "side_left", "side_right", "front"])
def test_a_camera_of_70_degrees_keeps_who_sets_off_and_turns(view):
    config = FollowerConfig(view=view)

    def walking(time):
        return Twist2D(1.2, 0.0, 1.5 if 3.0 < time < 5.0 else 0.0)

    fov = math.radians(70.0)
    for person, robot in walk(config, walking, 10.0, kept_view(fov)):
        seen = robot.between(person)
        assert abs(math.atan2(seen.y, seen.x)) < fov / 2


def test_the_field_of_view_is_that_of_the_sensor():
    assert kept_view(math.tau) == ALL_AROUND
    assert kept_view(math.radians(70.0), 1.0) == pytest.approx((math.radians(20.0), 1.0))
    assert kept_view(math.radians(20.0)) == pytest.approx((math.radians(5.0), 0.0))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_robot_whose_camera_looks_sideways_drives_beside_the_person_without_turning(side):
    config = FollowerConfig(bearing_deg=-90.0 * side, heading_deg=0.0)
    view = kept_view(math.radians(75.0), math.pi / 2 * side)
    for person, robot in walk(config, lambda time: Twist2D(min(time, 1.3)), 6.0, view):
        seen = robot.between(person)
        assert math.atan2(seen.y, seen.x) == pytest.approx(math.pi / 2 * side, abs=0.1)
        assert robot.yaw == pytest.approx(0.0, abs=1e-6)  # rounding


LINEAR, ANGULAR = Limits(2.0, 2.5, 2.5), Limits(3.0, 8.0, 8.0)
NEXUS = Drive(2.0, 1.0, 0.3, (LINEAR, LINEAR, ANGULAR))
LONG_S = 10.0
"""A step in which every axis reaches all of its velocities."""
speeds, rates = st.floats(-2.0, 2.0), st.floats(-3.0, 3.0)


@pytest.mark.parametrize(
    ("target", "direction", "turns_first", "expected"),
    [
        # the distance takes 1.5 m/s of the rims, the turn what is left, the bearing nothing
        ((1.5, 2.0, 3.0), math.pi, False, (-1.5, 0.0, 0.5 / 0.3)),
        # 3 rad/s, the limit of the axis, are 0.9 m/s of the rims
        ((2.0, 0.0, 5.0), 0.0, True, (1.1, 0.0, 3.0)),
        # diagonally both axes need the rims: 1 m/s each
        ((2.0, 0.0, 0.0), math.pi / 4, False, (1.0, 1.0, 0.0)),
        # the bearing gets what the planar speed of 1.8 m/s leaves
        ((1.7, 0.0, 0.0), 0.0, False, (1.7, 0.0, 0.0)),
        ((1.7, 2.0, 0.0), 0.0, False, (1.7, 0.3, 0.0)),
    ],
)
def test_speed_is_allocated_in_order(target, direction, turns_first, expected):
    twist = allocate(
        PolarTwist(*target), direction, STILL, NEXUS, 1.8, LONG_S, turns_first=turns_first
    )
    assert twist == pytest.approx(expected, abs=1e-9)


@given(st.builds(PolarTwist, speeds, speeds, rates), angles, speeds, speeds, rates, st.booleans())
def test_a_step_stays_within_all_limits(target, direction, x, y, yaw, turns_first):
    last = NEXUS.slowed(Twist2D(x, y, yaw))
    assume(math.hypot(last.x, last.y) <= 1.8)
    twist = allocate(target, direction, last, NEXUS, 1.8, DT, turns_first=turns_first)
    assert NEXUS.rims(twist) <= 2.0 + 1e-9  # rounding
    assert math.hypot(twist.x, twist.y) <= 1.8 + 1e-9
    for value, before, axis in zip(twist, last, NEXUS.axes, strict=True):
        low, high = axis.reach(before, DT)
        assert low - 1e-9 <= value <= high + 1e-9


def test_a_drive_without_limits_reaches_any_twist():
    twist = allocate(PolarTwist(3.0, 4.0, 5.0), math.pi / 2, STILL, Drive(), math.inf, DT)
    assert twist == pytest.approx((-4.0, 3.0, 5.0))


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
