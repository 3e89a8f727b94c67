"""A robot's body: round wheels, loads, Coulomb's friction along the rollers, and the URDF."""

import math

import dartpy as dart
import numpy as np
import pytest
from harness import load_robot
from mecazen.config.world import Box
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.robot import Payload, Robot
from mecazen.urdf import build_meshes, build_urdf
from mecazen_physics.world import GRAVITY
from msgspec.structs import replace
from physics_rig import Rig, masses, wheel_speeds


@pytest.mark.parametrize(
    ("name", "dt_s", "speed"),
    [("nexus", 0.005, 1.0), ("artbul", 0.001, 0.3), ("slant", 0.005, 1.0)],
)
def test_base_on_round_wheels_stays_level(name, dt_s, speed):
    robot = load_robot(name)
    rig = Rig(robot, dt_s=dt_s)
    directions = wheel_speeds(robot, Twist2D(0.6 * speed, 0.3 * speed, 0.4 * speed))
    for tick in range(200):
        state = rig.advance([min(1.0, tick / 50) * w for w in directions], round(0.01 / dt_s))
        # without a projection of positions it is g·dt² up and down: 0.01 mm and 0.25 mm
        assert abs(state.position[2]) < 1e-9
        assert state.tilt < 1e-9
        assert (*state.angular[:2], state.linear[2]) == pytest.approx((0.0,) * 3, abs=1e-9)


def test_high_load_tips_the_robot_over(nexus):
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


def test_a_robot_stands_still_when_its_wheels_do(robot):
    rig = Rig(robot)
    rig.drive(wheel_speeds(robot, Twist2D(0.3, -0.3, 0.2)), 1.26)
    for _ in range(100):
        rig.advance([0.0] * 4)
    # A wheel held at rest does not move along its roller's axis, and the axes cross: were two
    # parallel ones to carry everything, it would glide on at some 0.1 m/s. Contacts push it up by
    # 1 % of their depth a step, 0.1 mm/s, which its place does not follow: hence x and y alone.
    assert math.hypot(*rig.state().linear[:2]) < 1e-5
    # 2e-5: what the solver of the cone leaves, 0.07 degrees a minute
    assert math.hypot(*rig.state().angular) < 2e-5


def test_wheels_keep_contact_at_the_highest_speed(nexus):
    rig, fastest = Rig(nexus, dt_s=0.005), nexus.wheels.max_speed_rad_s
    for tick in range(300):
        rig.advance([min(1.0, tick / 150) * side * fastest for side in (0.7, 1.0, 0.7, 1.0)], 1)
        contacts = rig.body.world.dart.getLastCollisionResult().getContacts()
        assert len(contacts) >= 4, tick


HELD = [0.0] * 4
MU = 0.2


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


def test_each_wheel_carries_its_share_of_the_load(robot):
    robot = loaded(robot, 8.0, 0.06, -0.03, 0.30)
    mass, centre = centre_of_mass(robot)
    rig, (x, y, _) = Rig(robot), centre
    skeleton = rig.body.skeleton
    assert skeleton.getMass() == pytest.approx(mass, rel=1e-6)  # the swinging axle has 1 µg
    assert skeleton.getCOM() == pytest.approx(centre, abs=1e-6)
    rig.advance(HELD, 500)
    # the front axle swings about its middle: the rear wheels alone hold what is aside
    weight = mass * GRAVITY
    front = weight * (x / robot.wheels.wheelbase_m + 0.5)
    aside = weight * y / robot.wheels.track_m
    rear = (weight - front) / 2
    expected = [front / 2, front / 2, rear + aside, rear - aside]
    # 1 %: strained wheels push each other along their rollers, at the height of the ground
    assert wheel_loads(rig) == pytest.approx(expected, rel=0.01)


def test_loaded_robot_accelerates_by_its_mass(nexus):
    rig, torque = Rig(loaded(nexus, 10.0, 0.0, 0.0, 0.25)), 0.25 * nexus.wheels.max_torque_nm
    before = rig.advance_effort([torque] * 4, 100).linear[0]
    after = rig.advance_effort([torque] * 4, 200).linear[0]
    mass, turning = masses(nexus)
    expected = 4 * torque / nexus.wheels.radius_m / (mass + 10.0 + turning)
    assert (after - before) / 0.2 == pytest.approx(expected, rel=0.01)  # 1 %: the hull's chords


def without_bearing_friction(robot: Robot) -> Robot:
    rollers = replace(robot.rollers, bearing_friction_nms=0.0)
    return replace(robot, rollers=rollers)


def slide(rig: Rig, heading: float, speed: float, seconds: float) -> tuple[float, float]:
    """Throw a robot with its wheels held; return how it slows down and drifts aside [m/s²]."""
    rig.advance(HELD, 100)
    rig.throw(speed * math.cos(heading), speed * math.sin(heading))
    rig.advance(HELD, 20)  # the rollers take up their spin
    before = rig.state().linear
    after = rig.advance(HELD, round(1000 * seconds)).linear
    return (before[0] - after[0]) / seconds, (after[1] - before[1]) / seconds


@pytest.mark.parametrize(
    ("name", "yaw_deg"), [("nexus", 0.0), ("nexus", 22.5), ("artbul", 45.0), ("slant", 10.0)]
)
def test_locked_wheels_slow_down_alike_at_every_yaw(name, yaw_deg):
    robot = load_robot(name)
    yaw = math.radians(yaw_deg)
    rig = Rig(without_bearing_friction(robot), Pose2D(yaw=yaw), ground_friction=MU)
    slower, aside = slide(rig, yaw, 1.5, 0.3)
    # each wheel brakes with μN along its roller's axis, at γ to the axle
    assert slower == pytest.approx(MU * GRAVITY * math.sin(robot.roller_angle), rel=0.01)
    assert abs(aside) < 0.01


def test_obstacle_beside_the_robot_changes_no_friction(nexus):
    yaw = math.radians(22.5)
    # too close for a robot to be simulated by itself, beside it; it is not touched
    box = Box(size_m=(0.02, 0.02, 0.5), position_m=rotate(0.0, 0.235, yaw))
    robot = without_bearing_friction(nexus)
    rig = Rig(robot, Pose2D(yaw=yaw), ground_friction=MU, obstacles=(box,))
    rig.advance(HELD, 10)
    assert not rig.robot.isolated
    slower, aside = slide(rig, yaw, 0.25, 0.05)
    assert slower == pytest.approx(MU * GRAVITY / math.sqrt(2.0), rel=0.01)
    assert abs(aside) < 0.01


def write(robot, folder):
    (folder / "meshes").mkdir()
    for name, data in build_meshes(robot).items():
        (folder / name).write_bytes(data)
    file = folder / "robot.urdf"
    file.write_text(build_urdf(robot))
    return file


def test_independent_urdf_reader_finds_the_same_bodies(robot, tmp_path):
    file = write(robot, tmp_path)
    read = dart.utils.DartLoader().parseSkeleton(str(file))
    rig = Rig(robot)
    ours = rig.body.skeleton
    angles = dict(zip(rig.joint_names, np.linspace(-3.0, 3.0, len(rig.joint_names)), strict=True))
    for skeleton in (read, ours):
        for name, angle in angles.items():
            skeleton.getJoint(name).setPosition(0, angle)
    for index in range(ours.getNumBodyNodes()):
        body = ours.getBodyNode(index)
        if body.getName() == "front_axle":  # weighs nothing, and hardly swings
            continue
        other = read.getBodyNode(body.getName())
        found, expected = (each.getWorldTransform().matrix() for each in (other, body))
        np.testing.assert_allclose(found, expected, atol=1e-9)  # the URDF has twelve digits
    # DART gives a link without inertia, which is only a frame, 1 kg.
    nothing = dart.dynamics.Inertia(1e-12, np.zeros(3), 1e-12 * np.eye(3))
    read.getBodyNode("camera_depth_optical_frame").setInertia(nothing)
    # The world's base carries camera and lidar, so the whole robot is compared.
    assert read.getMass() == pytest.approx(ours.getMass(), rel=1e-9)
    np.testing.assert_allclose(read.getCOM(), ours.getCOM(), atol=1e-9)
    found, expected = (each.getMassMatrix()[:6, :6] for each in (read, ours))
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_optical_frame_follows_pan_and_tilt(nexus, tmp_path):
    camera = replace(nexus.camera, pitch_deg=20.0, yaw_deg=90.0)
    robot = replace(nexus, camera=camera)
    file = write(robot, tmp_path)
    read = dart.utils.DartLoader().parseSkeleton(str(file))
    frame = read.getBodyNode("camera_depth_optical_frame").getWorldTransform().matrix()
    c, s = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))
    # by REP-103: x to its right, which is ahead of the robot; y down; z to the left and up
    right, down, ahead = (1.0, 0.0, 0.0), (0.0, s, -c), (0.0, c, s)
    expected = np.column_stack([right, down, ahead])
    np.testing.assert_allclose(frame[:3, :3], expected, atol=1e-9)  # twelve digits
    np.testing.assert_allclose(frame[:3, 3], camera.position_m, atol=1e-9)
