from __future__ import annotations

import hashlib
import math
import os
import re
import subprocess
import sys

import dartpy as dart
import msgspec
import numpy as np
import pytest
from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import WHEEL_JOINTS, Robot
from mecazen.world import Box, Cylinder, Person
from mecazen_physics import model
from mecazen_physics.bodies import GRAVITY
from mecazen_physics.errors import DivergedError, UnsupportedError
from mecazen_physics.rollers import Roller, lateral_gain, yaw_gain
from physics_rig import Rig

FORWARD, LEFT, TURN = Twist2D(x=0.3), Twist2D(y=0.3), Twist2D(yaw=0.6)


def wheel_speeds(robot: Robot, twist: Twist2D) -> list[float]:
    """The ideal equations, wheels in the order of `WHEELS` [rad/s]."""
    turn = (robot.half_wheelbase + robot.half_track) * twist.yaw
    x, y = twist.x, twist.y
    return [
        speed / robot.wheels.radius_m
        for speed in (x - y - turn, x + y + turn, x + y - turn, x - y + turn)
    ]


def masses(robot: Robot) -> tuple[float, float]:
    """The robot's mass [kg], and what its turning wheels add to it as they roll [kg]."""
    roller, hub = Roller.of(robot), model.links(robot)[0]
    count = robot.rollers.count
    rest = robot.base.mass_kg + robot.camera.mass_kg + robot.lidar.mass_kg
    mass = rest + 4 * (robot.wheels.hub_mass_kg + count * roller.mass)
    # A roller off the ground turns with the wheel but for the turn about its own free axis.
    across = roller.inertia[0] * math.sin(roller.angle) ** 2
    about_axle = hub.moments[1] + count * (roller.mass * roller.axis_distance**2 + across)
    return mass, 4 * about_axle / robot.wheels.radius_m**2


@pytest.mark.parametrize(
    "start", [Pose2D(), Pose2D(1.5, -2.0, 2.5), Pose2D(-3.0, 0.1, -math.pi / 2)]
)
def test_a_new_world_is_at_rest_at_exactly_the_start_pose(robot, start):
    state = Rig(robot, start).state()
    assert state.position == (start.x, start.y, 0.0)
    assert state.yaw == pytest.approx(start.yaw, abs=1e-15)
    assert state.orientation[:2] == (0.0, 0.0)
    assert set(state.linear + state.angular) == {0.0}
    assert {*state.joint_position, *state.joint_velocity, *state.joint_effort} == {0.0}


def test_a_robot_without_command_stays_where_it_stands(robot):
    rig = Rig(robot)
    heights = [state.position[2] for state in rig.drive([0.0] * 4, 1.0)]
    # It starts in contact, so nothing falls: 1 µm is the depth of resting contacts.
    assert max(map(abs, heights)) < 1e-6
    assert math.hypot(*rig.state().position[:2]) < 1e-6


def test_joints_are_four_wheels_then_the_rollers_of_each(robot):
    rig = Rig(robot, ground_friction=0.0)
    count = robot.rollers.count
    assert rig.joint_names[:4] == WHEEL_JOINTS
    assert len(rig.joint_names) == 4 + 4 * count
    assert rig.joint_names[4] == "front_left_roller_00_joint"
    assert rig.joint_names[-1] == f"rear_right_roller_{count - 1:02d}_joint"
    rig.advance([1.0, 2.0, 3.0, 4.0], 10)
    assert rig.state().joint_velocity[:4] == pytest.approx([1.0, 2.0, 3.0, 4.0], abs=1e-6)
    assert len(rig.state().joint_effort) == len(rig.joint_names)


@pytest.mark.parametrize("rollers", ["near", "all"])
def test_forward_motion_is_ideal_and_smooth(robot, rollers):
    states = Rig(robot, rollers=rollers).drive(wheel_speeds(robot, FORWARD), 3.0)[100:]
    speed = (states[-1].position[0] - states[0].position[0]) / (states[-1].time - states[0].time)
    # 1 % is the requirement; nothing but the rollers' chords makes it differ at all.
    assert speed == pytest.approx(FORWARD.x, rel=0.01)
    heights = [state.position[2] for state in states]
    assert max(heights) - min(heights) < 1e-3 * robot.wheels.radius_m
    # The two wheels that carry a tenth more pull a little to the side.
    assert abs(states[-1].position[1]) < 2e-4


@pytest.mark.parametrize("rollers", ["near", "all"])
def test_lateral_motion_has_the_gain_that_the_rollers_geometry_predicts(robot, rollers):
    states = Rig(robot, rollers=rollers).drive(wheel_speeds(robot, LEFT), 3.0)[100:]
    gain = (states[-1].position[1] - states[0].position[1]) / 1.99 / LEFT.y
    assert gain == pytest.approx(1.0, abs=0.035)
    # No slip but at the hand-over between rollers, whose axes differ: 1 % is required.
    assert gain == pytest.approx(lateral_gain(robot), rel=0.01)
    assert abs(states[-1].position[0]) < 1e-3


@pytest.mark.parametrize(
    "twist", [Twist2D(0.3, 0.3), Twist2D(0.3, -0.3, 0.2), Twist2D(0.5, 0.0, 0.8)]
)
def test_a_robot_stands_still_when_its_wheels_do(robot, twist):
    rig = Rig(robot)
    rig.drive(wheel_speeds(robot, twist), 1.26)
    for _ in range(100):
        rig.advance([0.0] * 4)
    # A wheel held at rest does not move along its roller's axis, and the axes cross: were two
    # parallel ones to carry everything, it would glide on at some 0.1 m/s.
    assert math.hypot(*rig.state().linear) < 1e-6
    assert math.hypot(*rig.state().angular) < 1e-5


def test_each_wheel_carries_a_quarter_of_the_weight(robot):
    rig = Rig(robot)
    rig.drive([0.0] * 4, 0.5)
    contacts = rig.body.world.simulation.getLastCollisionResult().getContacts()
    loads = [float(contact.force[2]) for contact in contacts]
    weight = masses(robot)[0] * GRAVITY
    assert sum(loads) == pytest.approx(weight, rel=0.01)
    # A tenth more or less on the diagonals; camera, lidar and the absent rollers are 6 % more.
    assert loads == pytest.approx([weight / 4] * 4, rel=0.2)


@pytest.mark.parametrize("rollers", ["near", "all"])
def test_turning_on_the_spot_has_the_gain_that_the_rollers_geometry_predicts(robot, rollers):
    states = Rig(robot, rollers=rollers).drive(wheel_speeds(robot, TURN), 3.0)[100:]
    gain = (states[-1].yaw - states[0].yaw) / 1.99 / TURN.yaw
    assert gain == pytest.approx(yaw_gain(robot), rel=0.01)
    assert math.hypot(*states[-1].position[:2]) < 5e-3  # the rollers' contacts wander


def test_velocity_is_in_the_axes_of_base_link(nexus):
    rig = Rig(nexus, Pose2D(yaw=2.0))
    before, after = rig.drive(wheel_speeds(nexus, Twist2D(0.3, 0.0, 0.4)), 1.0)[-2:]
    # Ripple of the contacts: some mm/s.
    assert after.linear == pytest.approx((0.3, 0.0, 0.0), abs=0.01)
    assert after.angular == pytest.approx((0.0, 0.0, 0.4), abs=0.08)
    # The same as DART's, and as the finite difference over 10 ms.
    body = rig.body.skeleton.getBodyNode(0)
    np.testing.assert_allclose(
        (*after.angular, *after.linear), body.getSpatialVelocity(), atol=1e-9
    )
    np.testing.assert_allclose(
        np.subtract(after.position, before.position)[:2] / 0.01,
        body.getLinearVelocity()[:2],
        atol=0.01,
    )


@pytest.mark.parametrize("rollers", ["near", "all"])
def test_wheel_torque_accelerates_the_mass_and_the_turning_wheels(robot, rollers):
    rig = Rig(robot, rollers=rollers)
    torque = 0.05
    rig.advance_effort([torque] * 4, 1000)
    mass, turning = masses(robot)
    expected = 4 * torque / robot.wheels.radius_m / (mass + turning)
    # 2 %: each hand-over sets a roller turning, and chords of the barrel cost a little.
    assert rig.state().linear[0] == pytest.approx(expected, rel=0.02)
    assert rig.state().joint_effort[:4] == [torque] * 4


def test_a_coasting_robot_only_loses_energy_and_little(robot):
    rig = Rig(robot)
    rig.drive(wheel_speeds(robot, FORWARD), 1.0)
    energies = []
    for _ in range(100):
        rig.advance_effort([0.0] * 4)
        energies.append(rig.body.skeleton.computeKineticEnergy())
    # Ripple of 0.02 mm stores m·g·20 µm = 3 mJ of some 0.7 J for a while.
    assert (np.diff(energies) < 0.005 * energies[0]).all()
    # Chords and hand-overs take 0.3 N from a robot of 130 N, less than rubber on a floor.
    assert 0.8 * energies[0] < energies[-1] < energies[0]


@pytest.mark.parametrize("drive_by", ["velocity", "effort"])
def test_standing_wheels_hold_the_robot_on_a_slope_with_the_torque_of_its_weight(robot, drive_by):
    rig = Rig(robot, slope_deg=10.0, drive=drive_by)
    state = rig.drive([0.0] * 4, 3.0)[-1]
    weight = masses(robot)[0] * GRAVITY * math.sin(math.radians(10.0))
    # 3 %: the PID's integral part is still settling, and the robot creeps as it does.
    assert sum(state.joint_effort[:4]) == pytest.approx(weight * robot.wheels.radius_m, rel=0.03)
    assert abs(state.position[0]) < 0.01


def test_free_wheels_let_the_robot_roll_down_the_slope(robot):
    heading = math.radians(90.0)
    rig = Rig(robot, Pose2D(yaw=heading), slope_deg=5.0, slope_heading_deg=90.0)
    rig.advance_effort([0.0] * 4, 500)
    mass, turning = masses(robot)
    expected = -0.5 * GRAVITY * math.sin(math.radians(5.0)) * mass / (mass + turning)
    # 2 %: as for the acceleration by torque.
    assert rig.state().linear[0] == pytest.approx(expected, rel=0.02)
    assert rig.state().position[1] < 0.0


def test_friction_limits_what_holds_on_a_slope(robot):
    rig = Rig(robot, slope_deg=30.0, ground_friction=0.2)
    rig.advance([0.0] * 4, 500)
    slope = math.radians(30.0)
    expected = -0.5 * GRAVITY * (math.sin(slope) - 0.2 * math.cos(slope))
    # Coulomb, exact in DART; 1e-4: it yaws a little, as one diagonal carries more.
    assert rig.state().linear[0] == pytest.approx(expected, rel=1e-4)


def test_bearing_friction_costs_the_power_that_the_rollers_speeds_predict(nexus):
    def power(friction: float) -> float:
        rollers = msgspec.structs.replace(nexus.rollers, bearing_friction_nms=friction)
        robot = msgspec.structs.replace(nexus, rollers=rollers)
        states = Rig(robot).drive(wheel_speeds(robot, LEFT), 3.0)
        return float(
            np.mean([np.dot(s.joint_effort[:4], s.joint_velocity[:4]) for s in states[100:]])
        )

    friction = 5e-5
    roller = Roller.of(nexus)
    arc = np.linspace(-roller.half_arc, roller.half_arc, 101)
    radius = roller.wheel_radius - roller.axis_distance / np.cos(arc)
    spin = LEFT.y * lateral_gain(nexus) / math.sin(roller.angle) / radius
    handovers = roller.count * wheel_speeds(nexus, LEFT)[1] / (2.0 * math.pi)
    # A roller stops before it meets the ground again: half of what spins it up goes into skid.
    spin_up = roller.inertia[1] * np.mean(spin**2) * handovers
    expected = 4 * (friction * np.mean(spin**2) + spin_up)
    # 10 %: of it 7 % by the step's length; and the mean gain stands for all angles.
    assert power(friction) - power(0.0) == pytest.approx(expected, rel=0.1)


def test_the_motors_limits_hold(robot):
    rig = Rig(robot, ground_friction=0.0)
    limit = robot.wheels.max_torque_nm
    for _ in range(50):
        rig.advance([1e3, -1e3, 1e3, -1e3])
        state = rig.state()
        assert max(map(abs, state.joint_effort[:4])) <= limit * (1 + 1e-9)  # solver's rounding
        assert max(map(abs, state.joint_velocity[:4])) <= robot.wheels.max_speed_rad_s * (1 + 1e-6)


def test_motors_too_weak_for_a_slope_let_the_robot_roll_down_with_all_their_torque(robot):
    weight = masses(robot)[0] * GRAVITY * math.sin(math.radians(10.0))
    limit = 0.15 * weight * robot.wheels.radius_m  # 0.25 would hold it
    wheels = msgspec.structs.replace(robot.wheels, max_torque_nm=limit)
    weak = msgspec.structs.replace(robot, wheels=wheels)
    rig = Rig(weak, slope_deg=10.0)
    torques = []
    for _ in range(50):
        rig.advance([0.0] * 4)
        torques.append(rig.state().joint_effort[:4])
    # at once, and to the solver's rounding
    assert np.array(torques) == pytest.approx(limit, rel=1e-9)
    expected = -0.5 * 0.4 * weight / sum(masses(robot))
    # 2 %: as for the acceleration by torque.
    assert rig.state().linear[0] == pytest.approx(expected, rel=0.02)


def test_commanded_torque_is_limited_and_stops_at_the_motors_speed(robot):
    rig = Rig(robot, ground_friction=0.0)
    rig.advance_effort([100.0, -100.0, 0.0, 0.0], 1)
    limit, fastest = robot.wheels.max_torque_nm, robot.wheels.max_speed_rad_s
    assert rig.state().joint_effort[:4] == [limit, -limit, 0.0, 0.0]
    rig.advance_effort([100.0, -100.0, 0.0, 0.0], 200)
    speeds = rig.state().joint_velocity
    step = limit / model.links(robot)[0].moments[1] * 1e-3  # at most one step's gain beyond
    assert fastest <= speeds[0] <= fastest + step
    assert -fastest - step <= speeds[1] <= -fastest


def test_the_pid_drive_reaches_the_commanded_speed(robot):
    rig = Rig(robot, drive="effort")
    states = rig.drive(wheel_speeds(robot, FORWARD), 2.0)[150:]
    # 0.5 %: the hand-over between rollers disturbs the wheels by some 0.2 %.
    assert np.mean([s.joint_velocity[:4] for s in states]) * robot.wheels.radius_m == pytest.approx(
        FORWARD.x, rel=0.005
    )
    assert max(abs(e) for s in states for e in s.joint_effort[:4]) <= robot.wheels.max_torque_nm


def test_wheels_spin_on_the_spot_without_friction(nexus):
    rig = Rig(nexus, ground_friction=0.0)
    rig.drive(wheel_speeds(nexus, FORWARD), 0.5)
    # Nothing moves the centre of mass; 1e-5 m: below it the origin moves as the base leans.
    assert math.hypot(*rig.state().position[:2]) < 1e-5
    assert rig.state().joint_velocity[0] == pytest.approx(FORWARD.x / 0.05 * 0.98, rel=0.01)


def test_a_standing_person_stops_the_robot(nexus):
    rig = Rig(nexus)
    rig.place_person(Pose2D(0.8, 0.0, 1.0), Twist2D())
    rig.drive(wheel_speeds(nexus, Twist2D(x=0.2)), 3.0)
    # Contact at 0.8 - 0.2 m; the base's front is 0.19 m ahead of its middle. 10 mm: it
    # yaws round the person, as its wheels do not all pull the same.
    assert rig.state().position[0] == pytest.approx(0.41, abs=0.01)


def test_a_walking_person_pushes_the_robot_and_is_not_slowed_down(nexus):
    rig = Rig(nexus, person=Person(radius_m=0.15))
    for index in range(150):
        rig.place_person(Pose2D(-0.6 + 0.005 * index, 0.0, 0.0), Twist2D(x=0.5))
        rig.advance([0.0] * 4)
    assert rig.state().linear[0] > 0.1
    assert rig.state().position[0] > 0.1
    # their own speed, integrated
    assert rig.body.world.people[0].getPositions() == pytest.approx((0.15, 0.0), abs=1e-9)


def test_the_persons_velocity_is_in_their_own_frame(nexus):
    rig = Rig(nexus)
    rig.place_person(Pose2D(0.43, 0.0, math.pi / 2), Twist2D(x=1.0))  # close, but not touching
    rig.advance([0.0] * 4, 100)
    assert rig.body.world.people[0].getPositions() == pytest.approx((0.43, 0.1), abs=1e-9)


@pytest.mark.parametrize(
    "obstacle",
    [
        Box(size_m=(0.2, 2.0, 0.5), position_m=(0.6, 0.0)),
        Box(size_m=(2.0, 0.2, 0.5), position_m=(0.6, 0.0), yaw_deg=90.0),
        Cylinder(size_m=(0.1, 0.5), position_m=(0.6, 0.0)),
    ],
)
def test_an_obstacle_stops_the_robot(nexus, obstacle):
    rig = Rig(nexus, obstacles=(obstacle,))
    states = rig.drive(wheel_speeds(nexus, Twist2D(x=0.2)), 2.0)
    reach = 0.19 if isinstance(obstacle, Cylinder) else 0.2  # the base's front, the wheels'
    # 15 mm: wheels that climb and skid along the obstacle's face.
    assert states[-1].position[0] == pytest.approx(0.5 - reach, abs=0.015)


def test_an_obstacle_to_drive_onto_is_refused(nexus):
    step = Box(size_m=(1.0, 1.0, 0.01), position_m=(1.0, 0.0))
    with pytest.raises(UnsupportedError, match=r"0\.01 m high"):
        Rig(nexus, obstacles=(step,))


def test_bearing_friction_beyond_the_steps_resolution_is_refused(nexus):
    rollers = msgspec.structs.replace(nexus.rollers, bearing_friction_nms=1e-3)
    robot = msgspec.structs.replace(nexus, rollers=rollers)
    with pytest.raises(UnsupportedError, match=r"below .* or physics\.dt_s"):
        Rig(robot)


@pytest.mark.parametrize("detector", ["DART", "FCL", "ODE"])
def test_a_detector_that_takes_the_rollers_for_something_else_is_refused(
    nexus, monkeypatch, detector
):
    monkeypatch.setattr(dart.simulation, "BULLET", getattr(dart.simulation, detector))
    with pytest.raises(UnsupportedError, match="does not simulate the rollers' shape"):
        Rig(nexus)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda robot: robot.setVelocity(8, math.nan), "not finite"),
        (lambda robot: robot.setPosition(15, math.inf), "not finite"),
        (lambda robot: robot.setPosition(5, -0.2), "below the ground"),
        (lambda robot: robot.setPosition(4, math.nan), "moved"),
        (lambda robot: robot.setVelocity(3, 1e5), "moved|not finite"),
    ],
)
def test_a_diverged_state_is_an_error_with_the_last_good_one(nexus, spoil, reason):
    rig = Rig(nexus, Pose2D(1.0, 2.0, 0.0))
    rig.advance([0.0] * 4, 10)
    spoil(rig.body.skeleton)
    with pytest.raises(DivergedError, match=reason) as caught:
        rig.advance([0.0] * 4, 10)
    good = re.search(r"last good state at 0\.010 s: position \(([^,]*),", str(caught.value))
    assert good
    assert float(good[1]) == pytest.approx(1.0)
    assert rig.state().time == pytest.approx(0.01)


def trajectory(robot: Robot) -> str:
    """A hash of a run with everything in it."""
    obstacles = (
        Cylinder(size_m=(0.1, 0.5), position_m=(0.5, 0.1)),
        Box(size_m=(0.1, 2.0, 0.5), position_m=(-0.6, 0.0), yaw_deg=20.0),
    )
    rig = Rig(robot, Pose2D(0.1, -0.2, 0.3), obstacles=obstacles)
    digest = hashlib.sha256()
    for index in range(120):
        rig.place_person(Pose2D(0.9 - 0.005 * index, 0.1, math.pi), Twist2D(x=0.5))
        twist = Twist2D(0.4 * math.cos(0.1 * index), 0.3 * math.sin(0.1 * index), 0.5)
        if index % 30 < 25:
            rig.advance(wheel_speeds(robot, twist))
        else:
            rig.advance_effort([0.3, -0.2, 0.1, 0.4])
        digest.update(repr(rig.state()).encode())
    return digest.hexdigest()


def test_a_world_built_again_repeats_every_bit(nexus):
    first = trajectory(nexus)
    other = Rig(nexus)
    other.advance([3.0] * 4, 100)
    assert trajectory(nexus) == first


def test_every_process_computes_the_same_bits(nexus):
    code = (
        "import importlib.util as u, sys; from harness import load_robot; "
        "spec = u.spec_from_file_location('test_world', sys.argv[1]); "
        "tests = u.module_from_spec(spec); spec.loader.exec_module(tests); "
        "print(tests.trajectory(load_robot('nexus')))"
    )
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", code, __file__],
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": os.pathsep.join(sys.path)},
            stdout=subprocess.PIPE,
            text=True,
        )
        for seed in ("0", "1", "4711")
    ]
    hashes = {process.communicate(timeout=60)[0].strip() for process in processes}
    assert hashes == {trajectory(nexus)}
