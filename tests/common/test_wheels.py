"""Wheels: the published equations by hand, and how their watchdog brakes."""

import math

import pytest
from harness import load_robot
from hypothesis import given
from hypothesis import strategies as st
from mecazen.config import ControllerConfig, PhysicsConfig, Scenario, SensorConfig
from mecazen.config.services import AngularLimits, AxisLimits, LinearLimits
from mecazen.drive import Drive
from mecazen.errors import ConfigError
from mecazen.geometry import Twist2D
from mecazen.wheels import MecanumKinematics, Watchdog, WheelCommand
from msgspec.structs import replace

ROBOT = MecanumKinematics(wheel_radius=0.05, half_wheelbase=0.15, half_track=0.1)
STILL = (0.0,) * 4
# the wheels of nexus, 0.05 m, move it at 0.5 m/s forward and 0.25 m/s to the left
DIAGONAL = WheelCommand((5.0, 15.0, 15.0, 5.0))

speeds = st.floats(-100.0, 100.0)
twists = st.builds(Twist2D, speeds, speeds, speeds)


@pytest.mark.parametrize(
    ("cross_gain", "twist", "wheels"),
    [
        (1.0, (0.5, 0.0, 0.0), (10.0, 10.0, 10.0, 10.0)),
        (1.0, (0.0, 0.5, 0.0), (-10.0, 10.0, 10.0, -10.0)),
        # 0.25 m of lever at 2 rad/s is 0.5 m/s
        (1.0, (0.0, 0.0, 2.0), (-10.0, 10.0, -10.0, 10.0)),
        (1.0, (1.0, -0.5, 0.4), (28.0, 12.0, 8.0, 32.0)),
        # cot 30° = 1.7321: slower to the side; a lever of 0.1 + 1.7321·0.15 = 0.3598 m
        (math.sqrt(3.0), (0.0, 0.5, 0.0), (-17.3205, 17.3205, 17.3205, -17.3205)),
        (math.sqrt(3.0), (0.0, 0.0, 2.0), (-14.3923, 14.3923, -14.3923, 14.3923)),
        # an O is an X to the other side; a lever of 0.1 - 0.15 = -0.05 m
        (-1.0, (0.0, 0.5, 0.0), (10.0, -10.0, -10.0, 10.0)),
        (-1.0, (0.0, 0.0, 2.0), (2.0, -2.0, 2.0, -2.0)),
    ],
)
def test_equations_by_hand_both_ways(cross_gain, twist, wheels):
    robot = MecanumKinematics(0.05, 0.15, 0.1, cross_gain)
    assert robot.inverse(Twist2D(*twist)) == pytest.approx(wheels, abs=1e-4)  # as many digits
    assert robot.forward(robot.inverse(Twist2D(*twist))) == pytest.approx(twist, abs=1e-12)


def test_a_twist_is_that_of_base_link():
    # 0.2 m behind the wheels' centre, which moves to the left at 0.2 m/s in a turn of 1 rad/s
    robot = MecanumKinematics(0.05, 0.15, 0.1, centre=(0.2, 0.0))
    assert robot.inverse(Twist2D(0.0, 0.0, 1.0)) == pytest.approx((-9.0, 9.0, -1.0, 1.0))
    twist = Twist2D(1.0, -0.5, 0.4)
    robot = MecanumKinematics(0.05, 0.15, 0.1, -1.7, (0.1, -0.05))
    assert robot.forward(robot.inverse(twist)) == pytest.approx(twist, abs=1e-12)


def test_lengths_with_which_an_o_cannot_turn_are_refused():
    robot = load_robot()
    wide = replace(robot.wheels, track_m=0.5)
    robot = replace(robot, wheels=wide, rollers=replace(robot.rollers, arrangement="O"))
    assert MecanumKinematics.from_robot(robot).lever == pytest.approx(0.25 - 0.15)
    with pytest.raises(ConfigError, match=r"half_track_m = 0\.15, .* lever of 0 m"):
        MecanumKinematics.from_robot(robot, ControllerConfig(half_track_m=0.15))


@given(twists, st.floats(0.1, 50.0))
def test_desaturation_keeps_the_direction_of_motion(twist, max_speed):
    wheels = ROBOT.inverse(twist)
    limited = wheels.desaturate(max_speed)
    fastest = max(map(abs, wheels))
    assert max(map(abs, limited)) <= max_speed
    if fastest <= max_speed:
        assert limited == wheels
    ratio = min(1.0, max_speed / fastest) if fastest else 1.0
    expected = Twist2D(*(ratio * v for v in twist))
    assert ROBOT.forward(limited) == pytest.approx(expected, abs=1e-9)


@given(st.floats(0.2, 5.0), st.floats(0.3, 2.0), st.floats(0.05, 0.5), twists)
def test_a_drive_is_slowed_as_the_controller_slows_wheels(rim_speed, sideways, lever, twist):
    radius, half = 0.05, 0.15
    kinematics = MecanumKinematics(radius, half, lever - half * sideways, sideways)
    driven = kinematics.forward(kinematics.inverse(twist).desaturate(rim_speed / radius))
    # speeds are rounded, and divided by a lever of 0.05 m
    assert Drive(rim_speed, sideways, lever).slowed(twist) == pytest.approx(driven, abs=1e-9)


def watchdog(**changes):
    return Watchdog(Scenario(robot=load_robot(), **changes))


@pytest.mark.parametrize(
    ("changes", "timeout_s"),
    [
        ({"physics": PhysicsConfig(watchdog_s=0.1)}, 0.1),
        # behind a guard, for no longer than the guard counts on
        ({"sensor": SensorConfig(also=("lidar",))}, 0.05),
    ],
)
def test_a_command_is_obeyed_until_it_is_too_old(changes, timeout_s):
    dog = watchdog(**changes)
    assert dog.command(None, math.inf, STILL).values == STILL
    assert dog.command(DIAGONAL, timeout_s, STILL) is DIAGONAL
    assert dog.command(None, timeout_s + 0.01, STILL) != DIAGONAL
    assert dog.command(DIAGONAL, 0.0, STILL) is DIAGONAL  # a new command ends the braking


def test_each_axis_of_the_robot_brakes_as_the_controller_brakes_it():
    limits = AxisLimits(LinearLimits(2.0, 2.5), LinearLimits(2.0, 5.0), AngularLimits())
    dog = watchdog(controller=ControllerConfig(limits=limits))
    dog.command(DIAGONAL, 0.0, STILL)
    for n in range(1, 21):
        command = dog.command(None, 1.0 + 0.01 * n, STILL)
        forward, left = max(0.5 - 0.025 * n, 0.0), max(0.25 - 0.05 * n, 0.0)
        expected = [(forward - left) / 0.05, (forward + left) / 0.05]
        assert command.values[:2] == pytest.approx(expected, abs=1e-9)


def test_after_an_effort_it_brakes_from_the_measured_speeds():
    dog = watchdog()
    dog.command(WheelCommand((0.3,) * 4, is_effort=True), 0.0, STILL)
    braking = dog.command(None, 1.0, (8.0,) * 4)
    # 2.5 m/s² are 0.5 rad/s in a tick
    assert (braking.values, braking.is_effort) == (pytest.approx([7.5] * 4), False)
