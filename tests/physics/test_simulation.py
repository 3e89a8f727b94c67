"""Robots and people in one world: those apart move as if alone, those in contact push."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from harness import load_robot
from mecazen.config.world import Cylinder
from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import Robot
from mecazen.skeleton import INDEX, JOINTS, LIMBS
from mecazen.wheels import WheelCommand
from mecazen_physics.body import DEEPEST_M
from mecazen_physics.footprint import Footprint
from mecazen_physics.people import LEGS, MovingPerson, place
from mecazen_physics.simulation import Simulation
from mecazen_physics.state import RobotState
from mecazen_physics.world import build_legs
from physics_rig import STEPS, Rig, simulation_of, throw, wheel_speeds

FORWARD = WheelCommand([6.0] * 4)  # 0.3 m/s of nexus
BACKWARD = WheelCommand([-6.0] * 4)
STAND = WheelCommand([0.0] * 4)
BRAKE = WheelCommand([-0.05] * 4, is_effort=True)
"""Motors that push back with 4 N."""
CLOSEST, TOUCHING = 0.39 - 1e-3, 0.40 + 0.05
"""Between nexus and nexus, one behind the other [m]: wheels touch wheels, or base and wheels where
one has slid aside, 1 mm deep. Within 5 cm who is pushed is met again."""
JUDDER = 0.05
"""A robot that is pushed runs ahead and is met again; so much a mean over a second may be off."""


def world_with(robot: Robot, *starts: Pose2D, **settings: Any) -> Simulation:
    return simulation_of([(robot, start) for start in starts], **settings)


def drive(world: Simulation, ticks: int, *commands: WheelCommand) -> list[list[RobotState]]:
    """The states of all robots at every tick; the first half second brings the wheels up."""
    states = []
    for tick in range(ticks):
        scale = min(1.0, tick / 50)
        scaled = [
            WheelCommand([scale * value for value in command.values], command.is_effort)
            for command in commands
        ]
        world.advance(scaled, STEPS)
        states.append([robot.state for robot in world.robots])
    return states


def along_x(state: RobotState) -> float:
    """A robot's velocity along world x [m/s]."""
    return state.linear[0] * math.cos(state.yaw) - state.linear[1] * math.sin(state.yaw)


def test_separate_robots_do_not_influence_each_other(nexus):
    starts = [Pose2D(), Pose2D(0.0, 3.0), Pose2D(0.0, 1.0, 1.0)]
    # four wheels of the third change their lowest roller within one step
    commands = [STAND, FORWARD, WheelCommand([6.0, -6.0, -6.0, 6.0])]
    obstacle = Cylinder(size_m=(0.1, 0.5), position_m=(0.4, 3.0))
    walk = Twist2D(x=0.4)

    def run(*numbers: int) -> list[RobotState]:
        world = world_with(nexus, *(starts[number] for number in numbers), obstacles=(obstacle,))
        for tick in range(80):
            if 0 in numbers:
                person = MovingPerson.upright(Pose2D(-0.5 + 0.004 * tick), walk)
                for robot in world.robots:
                    robot.place_person(0, person)
            world.advance([commands[number] for number in numbers], STEPS)
        return [robot.state for robot in world.robots]

    together = run(0, 1, 2)
    assert together == [*run(0), *run(1), *run(2)]
    assert together[0].position[0] > 0.0  # by the person
    # the obstacle stops its base, whose front is at 0.19 m; within 15 mm as its wheels skid
    assert together[1].position[0] == pytest.approx(0.3 - 0.19, abs=0.015)


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2])
def test_collision_on_ice_conserves_momentum(nexus, yaw):
    world = world_with(nexus, Pose2D(), Pose2D(0.7, 0.0, yaw), ground_friction=0.0)
    throw(world.robots[0], 0.5)
    before = drive(world, 1, STAND, STAND)[-1]
    assert [along_x(state) for state in before] == pytest.approx([0.5, 0.0], abs=1e-6)
    slow, fast = (along_x(state) for state in drive(world, 150, STAND, STAND)[-1])
    # 1 % is for what turns: the bases' own velocity is not quite that of all of their mass
    assert slow + fast == pytest.approx(0.5, rel=0.01)
    # contacts hardly bounce: less than 4 % of the energy comes back; in contact they turn a bit
    assert -0.01 <= fast - slow < 0.2 * 0.5


@pytest.mark.parametrize(
    ("places", "pushed", "ticks"),
    [((0.0, 0.5, 1.0), "nexus", 200), ((0.0, 0.8), "artbul", 350)],
    ids=["two in a row", "another size"],
)
def test_a_robot_pushes_those_whose_motors_are_weaker(nexus, places, pushed, ticks):
    # for 2 s: a pushed robot whose wheels turn freely slides off aside in the end
    robots = [nexus, *[load_robot(pushed)] * (len(places) - 1)]
    world = simulation_of([*zip(robots, map(Pose2D, places), strict=True)])
    states = drive(world, ticks, FORWARD, *[BRAKE] * (len(places) - 1))
    # as fast as without a load, which its servos hold, but for slip; in contact they judder
    for early, late in zip(states[-101], states[-1], strict=True):
        assert late.position[0] - early.position[0] == pytest.approx(0.3, rel=JUDDER)
    if pushed == "nexus":
        gaps = [front.position[0] - rear.position[0] for rear, front in pairwise(states[-1])]
        assert [gap for gap in gaps if not CLOSEST <= gap <= TOUCHING] == []


def test_separated_robots_are_isolated_again(nexus):
    world = world_with(nexus, Pose2D(), Pose2D(0.62), Pose2D(5.0))
    first, second, third = world.robots

    def isolated() -> bool:
        return first.body.world is not second.body.world

    drive(world, 10, STAND, STAND, STAND)
    assert isolated()
    drive(world, 92, FORWARD, STAND, STAND)
    assert not isolated()
    assert third.body.world not in (first.body.world, second.body.world)
    drive(world, 200, BACKWARD, STAND, STAND)
    assert isolated()
    assert second.state.position[:2] == pytest.approx((0.62, 0.0), abs=1e-3)
    assert first.state.linear[0] == pytest.approx(-0.3, rel=0.01)


def test_returning_person_is_at_the_reported_place(nexus):
    rig = Rig(nexus)
    for x in (0.6, 5.0):  # close, and away
        rig.place_person(Pose2D(x=x))
        rig.advance([0.0] * 4)
    rig.place_person(Pose2D(x=-0.6))
    for _ in range(60):
        rig.advance([-12.0] * 4)
    # 0.35 m back without them; their side is at -0.4 m, and the robot's rear 0.2 m behind it
    assert rig.state().position[0] == pytest.approx(-0.2, abs=0.02)


STANDING = Footprint(0.0, 0.0, half_length=0.2, half_width=0.1)


@pytest.mark.parametrize(
    ("left", "right", "gap"),
    [
        (STANDING, Footprint(0.6, 0.0, rim=0.2), 0.2),
        (STANDING, Footprint(0.0, -0.6, rim=0.2), 0.3),
        (STANDING._replace(yaw=math.pi / 2), Footprint(0.6, 0.0, rim=0.2), 0.3),
        # off its corner
        (STANDING, Footprint(0.5, 0.5, rim=0.2), 0.3),
        # a long wall along y
        (STANDING, Footprint(1.0, 2.0, math.pi / 2, 5.0, 0.1), 0.7),
        (STANDING, STANDING._replace(x=1.0), 0.6),
        # corner before corner: a bound by the circle round one of them
        (STANDING, STANDING._replace(x=1.0, y=1.0), math.hypot(0.8, 0.9) - math.hypot(0.2, 0.1)),
        (STANDING, STANDING._replace(x=1.0, yaw=math.pi / 4), 0.8 - 0.3 / math.sqrt(2)),
        (STANDING, Footprint(0.1, 0.0, rim=0.2), -0.2),
    ],
)
def test_gap_between_footprints_is_known(left, right, gap):
    assert left.gap(right) == pytest.approx(gap)
    assert right.gap(left) == pytest.approx(gap)


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
    rig.robot.place_person(0, person(joints))
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
        rig.robot.place_person(0, person(joints, (0.0, 0.0, -speed)))
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
