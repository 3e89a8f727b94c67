"""Coulomb's friction: a roller resists along its own axis alone, wherever the robot points."""

from __future__ import annotations

import math

import msgspec
import pytest
from mecazen.config.world import Box
from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import Robot
from mecazen_bench.engine import yaw_gain
from mecazen_physics.world import GRAVITY
from physics_rig import Rig, wheel_speeds

MU = 0.2
HELD = [0.0] * 4
CLOSE = Box(size_m=(0.02, 0.02, 0.5), position_m=(0.0, 0.235))
"""Too close for a robot to be simulated by itself, beside it; it is not touched."""


def without_bearing_friction(robot: Robot) -> Robot:
    rollers = msgspec.structs.replace(robot.rollers, bearing_friction_nms=0.0)
    return msgspec.structs.replace(robot, rollers=rollers)


def slide(rig: Rig, heading: float, speed: float, seconds: float) -> tuple[float, float]:
    """Throw a robot with its wheels held; return how it slows down and drifts aside [m/s²]."""
    rig.advance(HELD, 100)
    rig.throw(speed * math.cos(heading), speed * math.sin(heading))
    rig.advance(HELD, 20)  # the rollers take up their spin
    before = rig.state().linear
    after = rig.advance(HELD, round(1000 * seconds)).linear
    return (before[0] - after[0]) / seconds, (after[1] - before[1]) / seconds


@pytest.mark.parametrize("yaw_deg", [0.0, 10.0, 22.5, 45.0, 67.5])
def test_locked_wheels_slow_down_alike_at_every_yaw(robot, yaw_deg):
    yaw = math.radians(yaw_deg)
    rig = Rig(without_bearing_friction(robot), Pose2D(yaw=yaw), ground_friction=MU)
    slower, aside = slide(rig, yaw, 1.5, 0.3)
    # each wheel brakes with μN along its roller's axis, at γ to the axle
    assert slower == pytest.approx(MU * GRAVITY * math.sin(robot.roller_angle), rel=0.01)
    assert abs(aside) < 0.01


@pytest.mark.parametrize("yaw_deg", [0.0, 22.5])
def test_beside_an_obstacle_it_slides_as_in_the_open(nexus, yaw_deg):
    yaw = math.radians(yaw_deg)
    x, y = CLOSE.position_m
    place = (x * math.cos(yaw) - y * math.sin(yaw), x * math.sin(yaw) + y * math.cos(yaw))
    box = msgspec.structs.replace(CLOSE, position_m=place)
    robot = without_bearing_friction(nexus)
    rig = Rig(robot, Pose2D(yaw=yaw), ground_friction=MU, obstacles=(box,))
    rig.advance(HELD, 10)
    assert not rig.robot.isolated
    slower, aside = slide(rig, yaw, 0.25, 0.05)
    assert slower == pytest.approx(MU * GRAVITY / math.sqrt(2.0), rel=0.01)
    assert abs(aside) < 0.01


def touches_the_wall(rig: Rig) -> bool:
    contacts = rig.body.world.dart.getLastCollisionResult().getContacts()
    return any(abs(contact.normal[2]) < 0.5 for contact in contacts)


def test_along_a_wall_it_slides_as_in_the_open(nexus):
    wall = Box(size_m=(20.0, 0.2, 0.5), position_m=(0.0, 0.0))
    robot = without_bearing_friction(nexus)
    rig = Rig(robot, Pose2D(y=0.3), ground_friction=MU, obstacles=(wall,))
    rig.advance(HELD, 100)
    rig.throw(1.5, -0.2)
    while not touches_the_wall(rig):
        rig.advance(HELD, 10)
    before = rig.advance(HELD, 40)  # it bounces a little
    after = rig.advance(HELD, 150)
    assert after.position[1] < 0.3
    # rims transmit no friction: only the ground does
    expected = 0.15 * MU * GRAVITY / math.sqrt(2.0)
    assert before.linear[0] - after.linear[0] == pytest.approx(expected, rel=0.01)


def test_held_wheels_slide_down_a_slope_as_by_hand(robot):
    rig = Rig(without_bearing_friction(robot), slope_deg=30.0, ground_friction=MU)
    rig.advance(HELD, 500)
    slope = math.radians(30.0)
    expected = (
        -0.5 * GRAVITY * (math.sin(slope) - MU * math.sin(robot.roller_angle) * math.cos(slope))
    )
    # 2 %: within it the loads shift downhill, and rollers are set spinning
    assert rig.state().linear[0] == pytest.approx(expected, rel=0.02)
    assert abs(rig.state().linear[1]) < 0.01


def test_on_ice_it_turns_on_the_spot_as_its_inner_contacts_ask(nexus):
    rig = Rig(nexus, ground_friction=0.15)
    states = rig.drive(wheel_speeds(nexus, Twist2D(yaw=1.0)), 3.0)[100:]
    # 1 %: where the pairs change over, both slip for longer than with more grip
    gain = (states[-1].yaw - states[0].yaw) / 1.99
    assert gain == pytest.approx(yaw_gain(nexus), rel=0.01)
