"""The polar law on a robot with limits: it catches up, keeps the distance, and looks."""

import math

import pytest
from harness import load_robot
from mecazen.config import ControllerConfig, FollowerConfig, Scenario, SensorConfig
from mecazen.config.controller import AxisLimits, LinearLimits
from mecazen.drive import Drive
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen_follower.association import Measurement
from mecazen_follower.following import SEARCH, Following
from mecazen_follower.making import make_controller
from mecazen_follower.node import FollowerNode
from mecazen_follower.polar import ALL_AROUND, View, kept_view
from mecazen_follower.tracking import Frame
from msgspec.structs import replace

DT = 0.01
NEXUS = load_robot()
DRIVE = Drive.of(Scenario(robot=NEXUS))
EXACT = ((1e-8, 0.0, 0.0), (0.0, 1e-8, 0.0), (0.0, 0.0, 1e-8))


def walk(config, walking, seconds, view=ALL_AROUND):
    """Yield person and robot, which starts at rest in its place and does what is commanded.

    The person's body twist at a time is `walking`; the follower knows pose and velocity.
    """
    controller = make_controller(config, DRIVE, view)
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


def test_the_drive_is_that_of_the_robot_and_its_controller():
    assert (DRIVE.rim_speed, DRIVE.lever) == pytest.approx((2.0, 0.3))
    assert DRIVE.sideways == pytest.approx(1.0)
    rollers = replace(NEXUS.rollers, angle_deg=30.0, arrangement="O")
    crossed = Drive.of(Scenario(robot=replace(NEXUS, rollers=rollers)))
    # cot 30° along y; the lever of half track and half wheelbase, 0.15 m each, is a difference
    gain = math.sqrt(3.0)
    assert (crossed.sideways, crossed.lever) == pytest.approx((gain, 0.15 * (gain - 1.0)))
    limits = AxisLimits(x=LinearLimits(max_velocity_m_s=1.0))
    slow = Scenario(robot=NEXUS, controller=ControllerConfig(limits=limits))
    assert [axis.velocity for axis in Drive.of(slow).axes] == [1.0, 2.0, 3.0]


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


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_robot_that_does_not_see_all_around_turns_to_where_the_person_went(side):
    for view, yaw in ((ALL_AROUND, 0.0), (View(0.4), SEARCH * side)):
        following = Following(FollowerConfig(), SensorConfig(), DRIVE, view)
        robot = Pose2D()
        for tick in range(round(4.0 / DT)):
            measurement = Measurement(Pose2D(1.0, 0.5 * side), EXACT)
            seen = Frame(tick * DT, (measurement,)) if tick < 10 else None
            command = following.step(tick * DT, DT, robot, seen).command
        assert command == (0.0, 0.0, yaw)


def test_a_standoff_within_the_bodies_is_refused_in_one_line():
    def node(standoff_m):
        config = FollowerConfig(standoff_m=standoff_m)
        return FollowerNode(Scenario(robot=NEXUS, follower=config))

    with pytest.raises(ConfigError) as refused:
        node(0.5)
    assert str(refused.value) == (
        "follower.standoff_m = 0.5 must be at least 0.58: the radii of the person, 0.2, and of "
        "the robot, 0.28, and 0.1 between them"
    )
    node(0.6)


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


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_leaves_the_view_of_a_sideways_camera_is_looked_for_where_they_went(side):
    following = Following(FollowerConfig(), SensorConfig(), DRIVE, View(0.4, math.pi / 2))
    for tick in range(round(4.0 / DT)):
        # ahead is to the right of a camera that looks to the left
        measurement = Measurement(Pose2D(-0.5 * side, 1.0), EXACT)
        seen = Frame(tick * DT, (measurement,)) if tick < 10 else None
        command = following.step(tick * DT, DT, Pose2D(), seen).command
    assert command == (0.0, 0.0, SEARCH * side)
    assert SensorConfig().fov_deg == 360.0
