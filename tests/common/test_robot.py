"""The robot file: what follows from its lengths. Wrong files: test_wrong_inputs."""

import math

import msgspec
import pytest
from harness import load_robot
from mecazen.robot import CameraMount, Payload, roller_joint
from msgspec.structs import replace


@pytest.fixture
def robot():
    """A robot of round numbers: axles 0.4 m apart, wheels 0.3 m, 0.1 m in diameter."""
    robot = load_robot()
    wheels = replace(robot.wheels, wheelbase_m=0.4, track_m=0.3, radius_m=0.05, hub_width_m=0.04)
    base = replace(robot.base, length_m=0.3, width_m=0.2, height_m=0.1, clearance_m=0.04)
    rollers = replace(robot.rollers, count=4, max_radius_m=0.02)
    camera = CameraMount(size_m=(0.1, 0.1, 0.06), position_m=(0.0, 0.0, 0.2), mass_kg=0.1)
    lidar = replace(robot.lidar, position_m=(0.0, 0.0, 0.15), size_m=(0.03, 0.04))
    parts = {"wheels": wheels, "base": base, "rollers": rollers, "camera": camera}
    return replace(robot, **parts, lidar=lidar, payload=None)


def test_footprint_and_height_hold_all_parts(robot):
    # along: 0.2 m to the axle and a radius; across: 0.15 m to the wheel's middle and a radius,
    # since its rollers reach only (0.05 - 0.02) tan(45°) / tan(45°) + 0.02 = 0.05 m
    assert robot.footprint == pytest.approx((0.25, 0.2))
    assert robot.height == pytest.approx(0.23)
    # steeper rollers reach further: 0.03 / tan(30°) + 0.02
    steep = replace(robot, rollers=replace(robot.rollers, angle_deg=30.0))
    assert steep.footprint[1] == pytest.approx(0.15 + 0.03 * math.sqrt(3.0) + 0.02)
    load = Payload(mass_kg=1.0, position_m=(-0.3, 0.0, 0.3), size_m=(0.2, 0.5, 0.2))
    assert replace(robot, payload=load).footprint == pytest.approx((0.4, 0.25))
    assert replace(robot, payload=load).height == pytest.approx(0.4)


def test_a_robot_stands_about_its_wheels_and_turns_about_base_link(robot):
    behind = replace(robot, wheels=replace(robot.wheels, centre_m=(0.1, -0.05)))
    assert behind.wheel_position("front_right") == pytest.approx((0.3, -0.2, 0.05))
    # the rectangle is about base_link, with the nearer side as far out as the other
    assert behind.footprint == pytest.approx((0.35, 0.25))
    assert behind.swing == pytest.approx(0.15)
    with pytest.raises(ValueError, match=r"base_link is not between the wheels"):
        replace(robot.wheels, centre_m=(0.21, 0.0))


def test_rollers_too_thin_for_a_circle_are_refused(robot):
    # Rollers meet π/N from their middles. There the wheel's circle is R cos(π/N) below the axle,
    # and a roller's axis, straight and level, R - r: 0.0475 (1 - cos 30°) = 6.364 mm
    wheels = replace(robot.wheels, radius_m=0.0475)
    thick, thin = (
        replace(robot.rollers, count=6, max_radius_m=radius) for radius in (0.0064, 0.0063)
    )
    assert replace(robot, wheels=wheels, rollers=thick).rollers.count == 6
    with pytest.raises(ValueError, match=r"max_radius_m = 0.0063 must be above 0.006364: "):
        replace(robot, wheels=wheels, rollers=thin)


def test_wheels_are_at_the_corners_and_turn_the_robot_by_their_lever(robot):
    assert (robot.cross_gain, robot.lever) == (1.0, pytest.approx(0.15 + 0.2))
    steep = replace(robot, rollers=replace(robot.rollers, angle_deg=30.0, arrangement="O"))
    assert steep.cross_gain == pytest.approx(-math.sqrt(3.0))
    assert robot.wheel_position("front_left") == pytest.approx((0.2, 0.15, 0.05))
    assert robot.wheel_position("rear_right") == pytest.approx((-0.2, -0.15, 0.05))
    assert robot.wheels.joints[3] == "rear_right_wheel_joint"
    assert roller_joint("rear_right", 3) == "rear_right_roller_03_joint"


def test_a_camera_looks_up_and_to_the_left_by_positive_angles(robot):
    up = replace(robot.camera, pitch_deg=30.0).axes
    assert up[0] == pytest.approx((math.sqrt(0.75), 0.0, 0.5))
    left = replace(robot.camera, yaw_deg=90.0).axes
    assert left[0] == pytest.approx((0.0, 1.0, 0.0))
    assert left[1] == pytest.approx((-1.0, 0.0, 0.0))
    beyond = {"size_m": [0.02, 0.09, 0.02], "position_m": [0.1, 0.0, 0.2], "mass_kg": 0.1}
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({**beyond, "pitch_deg": 91.0}, CameraMount)
