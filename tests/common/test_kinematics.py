"""The published equations, computed by hand, and their round trip."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.drive import Drive
from mecazen.geometry import Twist2D
from mecazen.kinematics import MecanumKinematics, WheelSpeeds

ROBOT = MecanumKinematics(wheel_radius=0.05, half_wheelbase=0.15, half_track=0.1)
speeds = st.floats(-100.0, 100.0)
twists = st.builds(Twist2D, speeds, speeds, speeds)


@pytest.mark.parametrize(
    ("twist", "wheels"),
    [
        ((0.5, 0.0, 0.0), (10.0, 10.0, 10.0, 10.0)),
        ((0.0, 0.5, 0.0), (-10.0, 10.0, 10.0, -10.0)),
        # 0.25 m of lever at 2 rad/s is 0.5 m/s
        ((0.0, 0.0, 2.0), (-10.0, 10.0, -10.0, 10.0)),
        ((0.5, 0.5, 0.0), (0.0, 20.0, 20.0, 0.0)),
        ((1.0, -0.5, 0.4), (28.0, 12.0, 8.0, 32.0)),
    ],
)
def test_equations_by_hand_both_ways(twist, wheels):
    assert ROBOT.inverse(Twist2D(*twist)) == pytest.approx(wheels)
    assert ROBOT.forward(WheelSpeeds(*wheels)) == pytest.approx(twist, abs=1e-12)


@pytest.mark.parametrize(
    ("cross_gain", "twist", "wheels"),
    [
        # cot 30° = 1.7321: slower to the side; a lever of 0.1 + 1.7321·0.15 = 0.3598 m
        (math.sqrt(3.0), (0.0, 0.5, 0.0), (-17.3205, 17.3205, 17.3205, -17.3205)),
        (math.sqrt(3.0), (0.0, 0.0, 2.0), (-14.3923, 14.3923, -14.3923, 14.3923)),
        # an O is an X to the other side; a lever of 0.1 - 0.15 = -0.05 m
        (-1.0, (0.0, 0.5, 0.0), (10.0, -10.0, -10.0, 10.0)),
        (-1.0, (0.0, 0.0, 2.0), (2.0, -2.0, 2.0, -2.0)),
        (-1.0, (0.5, 0.0, 0.0), (10.0, 10.0, 10.0, 10.0)),
    ],
)
def test_other_angles_and_arrangements_by_hand_both_ways(cross_gain, twist, wheels):
    robot = MecanumKinematics(0.05, 0.15, 0.1, cross_gain)
    assert robot.inverse(Twist2D(*twist)) == pytest.approx(wheels, abs=1e-4)  # as many digits
    assert robot.forward(robot.inverse(Twist2D(*twist))) == pytest.approx(twist, abs=1e-12)


def test_wheels_that_fight_each_other_do_not_move_the_body():
    assert ROBOT.forward(WheelSpeeds(1.0, 1.0, -1.0, -1.0)) == Twist2D()


def test_speeds_within_the_limit_stay_as_they_are():
    wheels = WheelSpeeds(28.0, 12.0, -8.0, -32.0)
    assert wheels.desaturate(32.0) == wheels
    assert WheelSpeeds().desaturate(1.0) == WheelSpeeds()


@given(twists, st.floats(0.1, 50.0))
def test_desaturation_keeps_the_direction_of_motion(twist, max_speed):
    wheels = ROBOT.inverse(twist)
    limited = wheels.desaturate(max_speed)
    assert max(map(abs, limited)) <= max_speed
    ratio = min(1.0, max_speed / max(map(abs, wheels), default=1.0)) if any(wheels) else 1.0
    expected = Twist2D(*(ratio * v for v in twist))
    assert ROBOT.forward(limited) == pytest.approx(expected, abs=1e-9)
    assert all(math.isfinite(speed) for speed in limited)


@given(st.floats(0.2, 5.0), st.floats(0.3, 2.0), st.floats(0.05, 0.5), twists)
def test_a_drive_is_slowed_as_the_controller_slows_its_wheels(rim_speed, sideways, lever, twist):
    radius, half = 0.05, 0.15
    kinematics = MecanumKinematics(radius, half, lever - half * sideways, sideways)
    driven = kinematics.forward(kinematics.inverse(twist).desaturate(rim_speed / radius))
    slowed = Drive(rim_speed, sideways, lever).slowed(twist)
    # speeds are rounded, and divided by a lever of 0.05 m
    assert tuple(slowed) == pytest.approx(driven, abs=1e-9)
