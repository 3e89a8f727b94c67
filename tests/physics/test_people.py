"""Robots touch the legs of a person who has joints."""

from __future__ import annotations

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


ENDS = [(limb.begin, limb.end) for limb in LEGS]


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


def test_shank_stops_the_robot_at_its_surface(nexus):
    rig = Rig(nexus)
    # the left leg is ahead of the robot's middle, whose front is its base's at 0.19 m
    joints = standing(0.45)
    joints[:, 1] -= 0.1
    joints[INDEX["left_heel"], 0] = joints[INDEX["left_foot"], 0] = 0.45  # no toes towards it
    rig.world.place_person(0, person(joints))
    for _ in range(90):
        state = rig.advance(wheel_speeds(nexus, Twist2D(0.3)))
    ahead = state.position[0] + 0.19
    assert ahead == pytest.approx(0.45 - SHANK, abs=2e-3)


@pytest.mark.parametrize("speed", [0.5, 10.0])
def test_foot_on_the_robot_does_not_sink_it(nexus, speed):
    rig = Rig(nexus)
    # the left heel comes down onto the rear left corner, where the toes point away from the robot
    joints = standing(-0.15, stance=0.3)
    joints[:, 0] -= np.where(joints[:, 0] > -0.15, 0.3, 0.0)
    joints[:, 2] += 0.4
    for tick in range(80):
        rig.world.place_person(0, person(joints, (0.0, 0.0, -speed)))
        state = rig.advance([0.0] * 4)
        joints[:, 2] -= speed * 0.01 if joints[INDEX["left_heel"], 2] > 0.1 else 0.0
        # a step of 1 ms at this speed, after which the robot is lifted
        assert state.position[2] > -0.001 * speed - DEEPEST_M, tick


def test_limbs_move_with_their_ends():
    joints, velocities = np.random.default_rng(2).normal(size=(2, len(JOINTS), 3))
    skeleton, dt = build_legs(), 1e-6
    walker = MovingPerson.of_joints(joints, velocities, HEIGHT)

    def middles_and_axes():
        frames = [body.getWorldTransform().matrix() for body in skeleton.getBodyNodes()]
        return np.array([(frame[:3, 3], frame[:3, 2]) for frame in frames])

    place(skeleton, walker)
    before = middles_and_axes()
    begins, ends = (joints[[INDEX[name] for name in names]] for names in zip(*ENDS, strict=True))
    np.testing.assert_allclose(before[:, 0], (begins + ends) / 2, atol=1e-12)
    skeleton.setVelocities(skeleton.getCommands())
    skeleton.integratePositions(dt)
    moved = middles_and_axes()
    velocities[:, 2] = 0.0  # a foot that comes down would shoot a robot aside
    place(skeleton, MovingPerson.of_joints(joints + dt * velocities, velocities, HEIGHT))
    np.testing.assert_allclose(moved - before, middles_and_axes() - before, atol=1e-10)
