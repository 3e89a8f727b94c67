from __future__ import annotations

import math
import os
import re
import subprocess
import sys

import dartpy as dart
import numpy as np
import pytest
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.robot import WHEEL_JOINTS, Payload
from mecazen.world import Box, Cylinder, Person
from mecazen_physics.bodies import GRAVITY
from mecazen_physics.errors import DivergedError, UnsupportedError
from mecazen_physics.rollers import lateral_gain, yaw_gain
from msgspec.structs import replace
from physics_rig import Rig, masses, trajectory, wheel_speeds

FORWARD, LEFT, TURN = Twist2D(x=0.3), Twist2D(y=0.3), Twist2D(yaw=0.6)


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
    # left and right are alike, to what the solver of the cone leaves
    assert abs(states[-1].position[1]) < 1e-5


@pytest.mark.parametrize("rollers", ["near", "all"])
def test_lateral_motion_has_the_gain_that_the_rollers_geometry_predicts(robot, rollers):
    states = Rig(robot, rollers=rollers).drive(wheel_speeds(robot, LEFT), 3.0)[100:]
    gain = (states[-1].position[1] - states[0].position[1]) / 1.99 / LEFT.y
    assert gain == pytest.approx(1.0, abs=0.035)
    # No slip but at the hand-over between rollers, whose axes differ: 1 % is required.
    assert gain == pytest.approx(lateral_gain(robot), rel=0.01)
    assert abs(states[-1].position[0]) < 1e-3


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
    # A wheel that rises slowly is held for some 0.01 s; 0.01 s of what it has at the end is 0.008.
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


def test_each_wheel_carries_a_quarter_of_the_weight(robot):
    rig = Rig(robot)
    rig.drive([0.0] * 4, 0.5)
    contacts = rig.body.scene.dart.getLastCollisionResult().getContacts()
    loads = [float(contact.force[2]) for contact in contacts]
    weight = masses(robot)[0] * GRAVITY
    assert sum(loads) == pytest.approx(weight, rel=0.01)
    # camera and lidar, of 2 % of the mass, are ahead and behind the middle
    assert loads == pytest.approx([weight / 4] * 4, rel=0.02)


@pytest.mark.parametrize("rollers", ["near", "all"])
def test_turning_on_the_spot_has_the_gain_that_the_rollers_geometry_predicts(robot, rollers):
    states = Rig(robot, rollers=rollers).drive(wheel_speeds(robot, TURN), 3.0)[100:]
    gain = (states[-1].yaw - states[0].yaw) / 1.99 / TURN.yaw
    assert gain == pytest.approx(yaw_gain(robot), rel=0.005)
    assert math.hypot(*states[-1].position[:2]) < 5e-3  # the rollers' contacts wander


@pytest.mark.parametrize("angle_deg", [30.0, 45.0, 60.0])
@pytest.mark.parametrize("arrangement", ["X", "O"])
def test_other_angles_and_arrangements_have_the_gains_of_their_geometry(
    nexus, angle_deg, arrangement
):
    rollers = replace(nexus.rollers, angle_deg=angle_deg, arrangement=arrangement, count=12)
    # not square, so that it can turn in the arrangement O too
    wheels = replace(nexus.wheels, wheelbase_m=0.42, track_m=0.28)
    robot = replace(nexus, rollers=rollers, wheels=wheels)
    left = Rig(robot).drive(wheel_speeds(robot, LEFT), 2.0)[100:]
    gain = (left[-1].position[1] - left[0].position[1]) / 0.99 / LEFT.y
    assert gain == pytest.approx(lateral_gain(robot), rel=0.01)
    turn = Rig(robot).drive(wheel_speeds(robot, TURN), 2.0)[100:]
    # 3 %: where the lever is short, 19 or 70 mm as an O, contacts wander by as much
    assert (turn[-1].yaw - turn[0].yaw) / 0.99 / TURN.yaw == pytest.approx(
        yaw_gain(robot), rel=0.03 if abs(robot.lever) < 0.1 else 0.01
    )


def test_velocity_is_in_the_axes_of_base_link(nexus):
    rig = Rig(nexus, Pose2D(yaw=2.0))
    before, after = rig.drive(wheel_speeds(nexus, Twist2D(0.3, 0.0, 0.4)), 1.0)[-2:]
    # Ripple of the contacts: some mm/s.
    assert after.linear == pytest.approx((0.3, 0.0, 0.0), abs=0.01)
    assert after.angular == pytest.approx((0.0, 0.0, 0.4), abs=0.08)
    # The same as DART's, and as the finite difference over 10 ms, in axes turned by `heading`.
    body, heading = rig.body.skeleton.getBodyNode(0), rig.body.scene.heading
    np.testing.assert_allclose(
        (*after.angular, *after.linear), body.getSpatialVelocity(), atol=1e-9
    )
    np.testing.assert_allclose(
        np.subtract(after.position, before.position)[:2] / 0.01,
        rotate(*body.getLinearVelocity()[:2], heading),
        atol=0.01,
    )


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
    assert rig.body.scene.people[0].getPositions() == pytest.approx((0.15, 0.0), abs=1e-9)


def test_the_persons_velocity_is_in_their_own_frame(nexus):
    rig = Rig(nexus)
    rig.place_person(Pose2D(0.43, 0.0, math.pi / 2), Twist2D(x=1.0))  # close, but not touching
    rig.advance([0.0] * 4, 100)
    assert rig.body.scene.people[0].getPositions() == pytest.approx((0.43, 0.1), abs=1e-9)


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


@pytest.mark.parametrize(
    ("tilt", "person", "isolated"),
    [
        (0.0, None, True),
        (0.04, 0.6, True),
        (0.06, None, False),
        (0.0, 0.42, False),  # 20 mm away
        (0.0, 0.44, True),
    ],
)
def test_a_robot_is_isolated_that_is_upright_and_out_of_reach_of_everything(
    nexus, tilt, person, *, isolated
):
    rig = Rig(nexus, rollers="all")
    motion = rig.body.read()
    motion.position[0] = tilt
    rig.body.write(motion)
    rig.robot.settle(0)
    if person is not None:
        rig.place_person(Pose2D(person))
    rig.robot.look_around()
    assert rig.robot.isolated == isolated


def test_an_obstacle_to_drive_onto_is_refused(nexus):
    step = Box(size_m=(1.0, 1.0, 0.01), position_m=(1.0, 0.0))
    with pytest.raises(UnsupportedError, match=r"0\.01 m high"):
        Rig(nexus, obstacles=(step,))


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


def test_a_world_built_again_repeats_every_bit(nexus):
    first = trajectory(nexus)
    other = Rig(nexus)
    other.advance([3.0] * 4, 100)
    assert trajectory(nexus) == first


def test_every_process_computes_the_same_bits(nexus):
    code = (
        "from harness import load_robot; from physics_rig import trajectory; "
        "print(trajectory(load_robot('nexus')))"
    )
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": os.pathsep.join(sys.path)},
            stdout=subprocess.PIPE,
            text=True,
        )
        for seed in ("0", "1", "4711")
    ]
    hashes = {process.communicate(timeout=60)[0].strip() for process in processes}
    assert hashes == {trajectory(nexus)}
