"""A robot on round wheels stands still, stays level, and is not held down."""

from __future__ import annotations

import math

import pytest
from harness import load_robot
from mecazen.geometry import Twist2D
from mecazen.robot import Payload
from msgspec.structs import replace
from physics_rig import Rig, wheel_speeds


@pytest.mark.parametrize("speed", [0.3, 1.0])
@pytest.mark.parametrize("dt_s", [0.001, 0.005])
def test_the_base_of_a_robot_on_round_wheels_neither_rises_nor_leans(robot, dt_s, speed):
    rig = Rig(robot, dt_s=dt_s)
    directions = wheel_speeds(robot, Twist2D(0.6 * speed, 0.3 * speed, 0.4 * speed))
    for tick in range(200):
        state = rig.advance([min(1.0, tick / 50) * w for w in directions], round(0.01 / dt_s))
        # without a projection of positions it is g·dt² up and down: 0.01 mm and 0.25 mm
        assert abs(state.position[2]) < 1e-9
        assert state.tilt < 1e-9


def test_a_robot_whose_load_tips_it_over_is_not_held_down(nexus):
    # its wheels stop at 1.5 m/s, with 30 kg 1.2 m up
    load = Payload(mass_kg=30.0, position_m=(0.0, 0.0, 1.2), size_m=(0.2, 0.2, 0.2))
    leans = []
    for dt_s in (0.001, 0.005):
        rig, steps = Rig(replace(nexus, payload=load), dt_s=dt_s), round(0.01 / dt_s)
        for tick in range(300):
            rig.advance([min(1.0, tick / 250) * 30.0] * 4, steps)
        leans.append([rig.advance([0.0] * 4, steps).tilt for _ in range(25)])
    fine, coarse = leans
    assert fine[-1] > math.radians(5.0)
    # A wheel that rises slowly is held for some 0.01 s; 0.01 s of its speed at the end are 0.008.
    assert coarse[-1] == pytest.approx(fine[-1], abs=0.012)


@pytest.mark.parametrize(
    "twist", [Twist2D(0.3, 0.3), Twist2D(0.3, -0.3, 0.2), Twist2D(0.5, 0.0, 0.8)]
)
def test_a_robot_stands_still_when_its_wheels_do(robot, twist):
    rig = Rig(robot)
    rig.drive(wheel_speeds(robot, twist), 1.26)
    for _ in range(100):
        rig.advance([0.0] * 4)
    # A wheel held at rest does not move along its roller's axis, and the axes cross: were two
    # parallel ones to carry everything, it would glide on at some 0.1 m/s. Contacts push it up by
    # 1 % of their depth a step, 0.1 mm/s, which its place does not follow: hence x and y alone.
    assert math.hypot(*rig.state().linear[:2]) < 1e-5
    # 2e-5: what the solver of the cone leaves, 0.07 degrees a minute
    assert math.hypot(*rig.state().angular) < 2e-5


@pytest.mark.parametrize("name", ["nexus", "artbul"])
def test_every_wheel_keeps_its_contact_up_to_the_highest_speed(name):
    robot = load_robot(name)
    rig, fastest = Rig(robot, dt_s=0.005), robot.wheels.max_speed_rad_s
    for tick in range(300):
        rig.advance([min(1.0, tick / 150) * side * fastest for side in (0.7, 1.0, 0.7, 1.0)], 1)
        contacts = rig.body.world.dart.getLastCollisionResult().getContacts()
        assert len(contacts) >= 4, tick
