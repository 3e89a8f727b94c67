"""Robots touch the legs of a person who has joints."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mecazen.geometry import Twist2D
from mecazen.skeleton import INDEX, JOINTS, LIMBS
from mecazen_physics.body import DEEPEST_M
from mecazen_physics.people import LEGS, MovingPerson, place
from mecazen_physics.world import build_legs
from physics_rig import Rig, wheel_speeds

HEIGHT = 1.75
SHANK = next(limb.radius for limb in LIMBS if limb.name == "left_shank") * HEIGHT


def standing(x: float, stance: float = 0.2) -> np.ndarray:
    """Return joints (20, 3) of a person at x, whose heels are there, `stance` apart along y."""
    joints = np.zeros((len(JOINTS), 3))
    joints[:, 0] = x
    joints[:, 2] = 1.5
    for side, y in (("left", stance / 2), ("right", -stance / 2)):
        for joint, ahead, z in (
            ("hip", 0.0, 0.93),
            ("knee", 0.0, 0.5),
            ("ankle", 0.0, 0.07),
            ("heel", 0.0, 0.0),
            ("foot", 0.15, 0.0),
        ):
            joints[INDEX[f"{side}_{joint}"]] = x + ahead, y, z
    joints[INDEX["pelvis"], 2] = 0.95
    return joints


def person(joints: np.ndarray, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)):
    return MovingPerson.of_joints(joints, np.broadcast_to(velocity, joints.shape), HEIGHT)


def forces(rig: Rig) -> list[float]:
    contacts = rig.body.world.dart.getLastCollisionResult().getContacts()
    return [float(np.linalg.norm(contact.force)) for contact in contacts]


def test_a_robot_is_stopped_by_a_shank_at_its_surface(nexus):
    rig = Rig(nexus)
    # the left leg is ahead of the robot's middle, whose front is its base's at 0.19 m
    joints = standing(0.45)
    joints[:, 1] -= 0.1
    joints[INDEX["left_heel"], 0] = joints[INDEX["left_foot"], 0] = 0.45  # no toes towards it
    rig.world.place_person(0, person(joints))
    for _ in range(120):
        state = rig.advance(wheel_speeds(nexus, Twist2D(0.3)))
        assert max(forces(rig)) < 1000.0  # four motors push with 240 N at most
    ahead = state.position[0] + 0.19
    assert ahead == pytest.approx(0.45 - SHANK, abs=2e-3)


def test_a_robot_drives_between_legs_that_stand_apart(nexus):
    rig = Rig(nexus)
    rig.world.place_person(0, person(standing(0.8, stance=0.7)))
    for _ in range(150):
        state = rig.advance(wheel_speeds(nexus, Twist2D(1.0)))
    # an upright cylinder would have stopped it before 0.6 m
    assert state.position[0] > 1.2
    assert state.yaw == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("speed", [0.5, 2.0, 10.0], ids="{} m/s".format)
def test_a_foot_that_steps_on_the_robot_does_not_press_it_into_the_ground(nexus, speed):
    rig = Rig(nexus)
    # the left heel comes down onto the rear left corner, where the toes point away from the robot
    joints = standing(-0.15, stance=0.3)
    joints[:, 0] -= np.where(joints[:, 0] > -0.15, 0.3, 0.0)
    joints[:, 2] += 0.4
    for tick in range(100):
        rig.world.place_person(0, person(joints, (0.0, 0.0, -speed)))
        state = rig.advance([0.0] * 4)
        joints[:, 2] -= speed * 0.01 if joints[INDEX["left_heel"], 2] > 0.1 else 0.0
        # a step of 1 ms at this speed, after which the robot is lifted
        assert state.position[2] > -0.001 * speed - DEEPEST_M, tick


def test_feet_that_reach_below_the_ground_touch_nothing(nexus):
    rig = Rig(nexus)
    rig.world.place_person(0, person(standing(0.42)))
    for _ in range(50):
        rig.advance([0.0] * 4)
    assert rig.body.world.people[0].getNumBodyNodes() == len(LEGS)  # they are close
    contacts = rig.body.world.dart.getLastCollisionResult().getContacts()
    for contact in contacts:  # none but those of rollers
        x, y, _ = map(abs, contact.point)
        assert math.dist((x, y), (0.15, 0.15)) < 0.03
    assert math.dist(rig.state().position, (0.0, 0.0, 0.0)) < 1e-4


def test_limbs_turn_and_move_as_their_ends_do_sideways():
    random = np.random.default_rng(2)
    joints, velocities = random.normal(size=(2, len(JOINTS), 3))
    velocities[:, 2] = 0.0
    skeleton, dt = build_legs(), 1e-6
    someone = MovingPerson.of_joints(joints, velocities, HEIGHT)
    falling = MovingPerson.of_joints(joints, velocities - (0.0, 0.0, 2.0), HEIGHT)

    def ends():
        frames = [body.getWorldTransform().matrix() for body in skeleton.getBodyNodes()]
        return np.array([f[:3, 3] for f in frames]), np.array([f[:3, 2] for f in frames])

    place(skeleton, falling)
    commands = skeleton.getCommands()
    place(skeleton, someone)
    np.testing.assert_array_equal(skeleton.getCommands(), commands)
    middles, axes = ends()
    skeleton.setVelocities(skeleton.getCommands())
    skeleton.integratePositions(dt)
    moved, turned = ends()
    place(skeleton, someone.after(dt))
    expected, expected_axes = ends()
    np.testing.assert_allclose(moved, expected, atol=1e-9)  # of 1e-6 s at some m/s
    np.testing.assert_allclose(turned - axes, expected_axes - axes, atol=1e-10)
    begin = [INDEX[limb.begin] for limb in LEGS]
    end = [INDEX[limb.end] for limb in LEGS]
    np.testing.assert_allclose(middles, (joints[begin] + joints[end]) / 2, atol=1e-12)
    along = joints[end] - joints[begin]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs(np.sum(along * axes, axis=1)), 1.0, atol=1e-12)


def test_legs_that_stride_reach_beyond_the_bodys_radius():
    joints = standing(0.0)
    joints[INDEX["left_foot"], :2] = 0.45, 0.0
    footprint = person(joints, (3.0, 0.0, 0.0)).footprint(0.2)
    assert footprint.rim == pytest.approx(0.45 + 0.018 * HEIGHT)
    assert footprint.speed == pytest.approx(3.0)
    assert person(joints).after(1.0).x == 0.0
    assert person(joints, (1.0, 0.0, 0.0)).after(0.5).legs.ends[2][0] == pytest.approx(0.95)
