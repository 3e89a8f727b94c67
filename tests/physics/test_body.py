"""A robot's body: round wheels, free rollers, its masses and loads."""

from __future__ import annotations

import math

import numpy as np
import pytest
from harness import load_robot
from mecazen.config.world import Box
from mecazen.geometry import Twist2D, rotate
from mecazen.robot import Payload, Robot
from mecazen.rollers import Roller
from mecazen_physics.errors import UnsupportedError
from mecazen_physics.state import BASE_DOFS
from mecazen_physics.world import GRAVITY
from msgspec.structs import replace
from physics_rig import Rig, masses, wheel_speeds


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


HELD = [0.0] * 4


def loaded(robot: Robot, mass: float, *position: float) -> Robot:
    return replace(robot, payload=Payload(mass_kg=mass, position_m=position))


def centre_of_mass(robot: Robot) -> tuple[float, np.ndarray]:
    """Mass [kg] and centre of mass [m], part by part by hand; wheels and rollers are symmetric."""
    unloaded, _ = masses(robot)
    base, camera, lidar, load = robot.base, robot.camera, robot.lidar, robot.payload
    wheels = unloaded - base.mass_kg - camera.mass_kg - lidar.mass_kg
    parts = [
        (base.mass_kg, (0.0, 0.0, base.clearance_m + base.height_m / 2)),
        (camera.mass_kg, camera.position_m),
        (lidar.mass_kg, lidar.position_m),
        (wheels, (0.0, 0.0, robot.wheels.radius_m)),
        (load.mass_kg, load.position_m),
    ]
    mass = sum(mass for mass, _ in parts)
    return mass, sum(mass * np.array(place) for mass, place in parts) / mass


def wheel_loads(rig: Rig) -> list[float]:
    """The forces of the ground on the wheels, of both contacts of each [N]."""
    loads = [0.0] * 4
    world = rig.body.world
    for contact in world.dart.getLastCollisionResult().getContacts():
        x, y, _ = contact.point
        ahead, aside = rotate(x, y, world.heading)  # the robot stands at the origin
        loads[2 * (ahead < 0.0) + (aside < 0.0)] += abs(contact.force[2])
    return loads


def test_the_centre_of_mass_is_that_of_a_calculation_by_hand(robot):
    robot = loaded(robot, 8.0, 0.06, -0.05, 0.30)
    mass, centre = centre_of_mass(robot)
    skeleton = Rig(robot).body.skeleton
    assert skeleton.getMass() == pytest.approx(mass, rel=1e-6)  # the swinging axle has 1 µg
    assert skeleton.getCOM() == pytest.approx(centre, abs=1e-6)


def test_each_wheel_carries_its_share_of_the_load(robot):
    robot = loaded(robot, 8.0, 0.06, -0.03, 0.30)
    mass, (x, y, _) = centre_of_mass(robot)
    rig = Rig(robot)
    rig.advance(HELD, 500)
    # the front axle swings about its middle: the rear wheels alone hold what is aside
    weight = mass * GRAVITY
    front = weight * (x / robot.wheels.wheelbase_m + 0.5)
    aside = weight * y / robot.wheels.track_m
    rear = (weight - front) / 2
    expected = [front / 2, front / 2, rear + aside, rear - aside]
    # 1 %: strained wheels push each other along their rollers, at the height of the ground
    assert wheel_loads(rig) == pytest.approx(expected, rel=0.01)


def test_motors_at_their_limit_accelerate_a_loaded_robot_by_as_much_less(nexus):
    torque = 0.25 * nexus.wheels.max_torque_nm

    def acceleration(robot: Robot) -> float:
        rig = Rig(robot)
        rig.advance_effort([torque] * 4, 100)
        before = rig.state().linear[0]
        return (rig.advance_effort([torque] * 4, 200).linear[0] - before) / 0.2

    mass, turning = masses(nexus)
    for payload in (0.0, 10.0):
        robot = loaded(nexus, payload, 0.0, 0.0, 0.25) if payload else nexus
        expected = 4 * torque / nexus.wheels.radius_m / (mass + payload + turning)
        # 1 %: the hull's chords
        assert acceleration(robot) == pytest.approx(expected, rel=0.01)


def test_wheels_without_load_slip_and_loaded_ones_do_not(nexus):
    """All weight is behind: the front wheels, which hardly press, can't brake their share."""
    behind = loaded(nexus, 30.0, -0.14, 0.0, 0.25)
    mass, (x, _, _) = centre_of_mass(behind)
    front = mass * GRAVITY * (x / nexus.wheels.wheelbase_m + 0.5)
    assert front < 0.2 * mass * GRAVITY
    rig = Rig(behind, ground_friction=0.3)
    # each front wheel can bear μN/√2 along, at 45° to its roller
    most = 0.3 * front / 2 / math.sqrt(2.0)
    torque = 1.5 * most * nexus.wheels.radius_m
    for _ in range(30):
        state = rig.advance_effort([torque] * 4)
    ideal = wheel_speeds(nexus, Twist2D(x=state.linear[0]))
    front_left, front_right, rear_left, rear_right = state.joint_velocity[:4]
    assert min(front_left, front_right) > 1.5 * ideal[0]
    assert (rear_left, rear_right) == pytest.approx(ideal[2:], rel=0.02)


def test_bearing_friction_beyond_the_steps_resolution_is_refused(nexus):
    rollers = replace(nexus.rollers, bearing_friction_nms=1e-3)
    robot = replace(nexus, rollers=rollers)
    with pytest.raises(UnsupportedError, match=r"below .* or physics\.dt_s"):
        Rig(robot)


def test_an_obstacle_to_drive_onto_is_refused(nexus):
    step = Box(size_m=(1.0, 1.0, 0.01), position_m=(1.0, 0.0))
    with pytest.raises(UnsupportedError, match=r"0\.01 m high"):
        Rig(nexus, obstacles=(step,))


def test_an_airborne_roller_keeps_its_spin_but_for_its_bearings_friction(nexus):
    friction = 2e-5
    robot = replace(nexus, rollers=replace(nexus.rollers, bearing_friction_nms=friction))
    rig = Rig(robot)
    fifth = BASE_DOFS + 4 + 4  # of the front left wheel, near the top
    rig.body.skeleton.setVelocity(fifth, 10.0)
    state = rig.advance([0.0] * 4, 100)
    decay = friction / Roller.from_robot(robot).inertia[1]
    # 6 %: DART's implicit steps of 1 ms, of a time constant of 30 ms, three times over.
    expected = 10.0 * math.exp(-0.1 * decay)
    assert state.joint_velocity[4 + 4] == pytest.approx(expected, rel=0.06)
    turned = 10.0 * (1.0 - math.exp(-0.1 * decay)) / decay
    assert state.joint_position[4 + 4] == pytest.approx(turned, rel=0.02)
