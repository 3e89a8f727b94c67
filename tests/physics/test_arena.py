"""Robots in one world: apart each moves as if it were the only one, together they push."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from harness import load_robot
from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import Robot
from mecazen_physics.arena import Arena
from mecazen_physics.config import Cylinder, PhysicsConfig
from mecazen_physics.errors import UnsupportedError
from mecazen_physics.world import WheelCommand, World, WorldState
from msgspec.structs import replace

STEPS = 10  # of 1 ms in a control period
FORWARD = WheelCommand([6.0] * 4)  # 0.3 m/s of nexus
BACKWARD = WheelCommand([-6.0] * 4)
STAND = WheelCommand([0.0] * 4)
ROLL = WheelCommand([0.0] * 4, is_effort=True)
"""Wheels without a motor."""
BRAKE = WheelCommand([-0.05] * 4, is_effort=True)
"""Motors that push back with 4 N."""
CLOSEST, TOUCHING = 0.38 - 1e-3, 0.40 + 0.05
"""Between nexus and nexus, one behind the other [m]: the boxes of their bases touch, and their
wheels; between these a roller may reach into the gap of two others. A millimetre is a facet's, and
within 5 cm who is pushed is met again: contacts judder, as rollers pass."""


JUDDER = 0.15
"""A robot that is pushed runs ahead and is met again; so much a mean over a second may be off."""


def arena_of(
    robot: Robot,
    *starts: Pose2D,
    config: PhysicsConfig = PhysicsConfig(),  # noqa: B008
) -> Arena:
    return Arena([(robot, start) for start in starts], config)


def drive(arena: Arena, ticks: int, *commands: WheelCommand) -> list[list[WorldState]]:
    """The states of all robots at every tick; the first half second brings the wheels up."""
    states = []
    for tick in range(ticks):
        scale = min(1.0, tick / 50)
        scaled = [
            WheelCommand([scale * value for value in command.values], command.is_effort)
            for command in commands
        ]
        arena.advance(scaled, STEPS)
        states.append([world.state() for world in arena.worlds])
    return states


def throw(arena: Arena, number: int, speed: float) -> None:
    """Give a robot a speed along world x."""
    scene = arena.worlds[number]._plant.scene
    motion = scene.read()
    motion.base_velocity[3] = speed
    scene.write(motion)


def along_x(state: WorldState) -> float:
    """A robot's velocity along world x [m/s]."""
    _, _, z, w = state.orientation
    yaw = 2.0 * math.atan2(z, w)
    return state.linear[0] * math.cos(yaw) - state.linear[1] * math.sin(yaw)


def speeds(states: list[list[WorldState]]) -> list[float]:
    """Along world x, of each in the last second [m/s]: in contact they judder."""
    pairs = zip(states[-101], states[-1], strict=True)
    return [late.position[0] - early.position[0] for early, late in pairs]


@pytest.mark.parametrize("rollers", ["near", "all"])
def test_robots_apart_move_as_each_would_alone_to_the_bit(nexus: Robot, rollers: str) -> None:
    starts = [Pose2D(), Pose2D(0.0, 1.0, 1.0), Pose2D(5.0, -3.0, -2.0)]
    commands = [FORWARD, WheelCommand([6.0, -6.0, -6.0, 6.0]), WheelCommand([-3.0, 5.0, -4.0, 9.0])]
    config = PhysicsConfig(rollers=rollers)
    together = drive(arena_of(nexus, *starts, config=config), 150, *commands)
    for number, (start, command) in enumerate(zip(starts, commands, strict=True)):
        alone = drive(arena_of(nexus, start, config=config), 150, command)
        assert [states[number] for states in together] == [states[0] for states in alone]


def test_a_single_robot_of_an_arena_moves_as_a_world_does(nexus: Robot) -> None:
    world, arena = World(nexus, PhysicsConfig(), Pose2D()), arena_of(nexus, Pose2D())
    for _ in range(30):
        world.advance([4.0, -9.0, 2.0, 7.0], 35)  # longer than robots look ahead
        arena.advance([WheelCommand([4.0, -9.0, 2.0, 7.0])], 35)
    assert arena.worlds[0].state() == world.state()


def test_robots_apart_are_pushed_each_by_its_person_and_by_an_obstacle_as_if_alone(
    nexus: Robot,
) -> None:
    starts = [Pose2D(), Pose2D(0.0, 3.0)]
    config = PhysicsConfig(obstacles=(Cylinder(size_m=(0.1, 0.5), position_m=(0.6, 3.0)),))
    walk = Twist2D(x=0.4)

    def pushed(*numbers: int) -> list[WorldState]:
        arena = arena_of(nexus, *(starts[number] for number in numbers), config=config)
        for tick in range(200):
            for place, number in enumerate(numbers):
                if number == 0:  # the other has nobody, and meets the obstacle
                    arena.place_person(place, Pose2D(-1.0 + 0.004 * tick), walk)
            arena.advance([(STAND, FORWARD)[number] for number in numbers], STEPS)
        return [world.state() for world in arena.worlds]

    together = pushed(0, 1)
    assert together == [*pushed(0), *pushed(1)]
    assert together[0].position[0] > 0.0  # by the person
    assert together[1].position[0] < 0.35  # where the obstacle stops it


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, math.pi])
def test_when_robots_collide_on_ice_the_momentum_of_both_is_kept(nexus: Robot, yaw: float) -> None:
    arena = arena_of(
        nexus, Pose2D(), Pose2D(0.7, 0.0, yaw), config=PhysicsConfig(ground_friction=0.0)
    )
    throw(arena, 0, 0.5)
    before = drive(arena, 1, STAND, STAND)[-1]
    assert [along_x(state) for state in before] == pytest.approx([0.5, 0.0], abs=1e-6)
    slow, fast = (along_x(state) for state in drive(arena, 150, STAND, STAND)[-1])
    # 1 % is for what turns: the bases' own velocity is not quite that of all of their mass
    assert slow + fast == pytest.approx(0.5, rel=0.01)
    # contacts hardly bounce: less than 4 % of the energy comes back; in contact they turn a bit
    assert -0.01 <= fast - slow < 0.2 * 0.5


def test_a_robot_pushes_one_whose_motors_are_weaker(nexus: Robot) -> None:
    states = drive(arena_of(nexus, Pose2D(), Pose2D(0.6)), 300, FORWARD, BRAKE)
    # as fast as without a load, which its servos hold, but for slip
    assert speeds(states) == pytest.approx([0.3, 0.3], rel=JUDDER)
    pusher, pushed = states[-1]
    assert CLOSEST <= pushed.position[0] - pusher.position[0] <= TOUCHING


def test_a_robot_that_is_hit_rolls_on_without_its_motors(nexus: Robot) -> None:
    arena = arena_of(nexus, Pose2D(), Pose2D(0.6))
    _, hit = drive(arena, 300, FORWARD, ROLL)[-1]
    assert hit.linear[0] > 0.25


def test_robots_driven_against_each_other_hold_each_other_up(nexus: Robot) -> None:
    arena = arena_of(nexus, Pose2D(), Pose2D(1.2, 0.0, math.pi))
    one, other = drive(arena, 250, FORWARD, FORWARD)[-1]
    # without the other each would have come 0.67 m far
    assert one.position[0] < 0.55
    assert other.position[0] > 0.65
    assert CLOSEST <= math.dist(one.position[:2], other.position[:2]) <= TOUCHING


def test_robots_that_have_met_and_parted_are_alone_again(nexus: Robot) -> None:
    arena = arena_of(nexus, Pose2D(), Pose2D(0.9))
    first, second = arena.worlds

    def scenes() -> list[str]:
        return [type(world._plant.scene).__name__ for world in arena.worlds]

    drive(arena, 10, STAND, STAND)
    assert scenes() == ["NearScene", "NearScene"]
    drive(arena, 150, FORWARD, STAND)
    assert scenes() == ["Scene", "Scene"]
    assert first.stage is second.stage
    drive(arena, 250, BACKWARD, STAND)
    assert scenes() == ["NearScene", "NearScene"]
    assert second.state().position[:2] == pytest.approx((0.9, 0.0), abs=1e-3)
    assert first.state().linear[0] == pytest.approx(-0.3, rel=0.01)


def test_of_three_in_a_row_the_middle_one_hands_the_push_on(nexus: Robot) -> None:
    arena = arena_of(nexus, Pose2D(), Pose2D(0.5), Pose2D(1.0))
    states = drive(arena, 300, FORWARD, BRAKE, BRAKE)
    assert speeds(states) == pytest.approx([0.3] * 3, rel=JUDDER)
    gaps = [b.position[0] - a.position[0] for a, b in pairwise(states[-1])]
    assert [gap for gap in gaps if not CLOSEST <= gap <= TOUCHING] == []


def test_a_robot_is_pushed_by_the_person_of_another(nexus: Robot) -> None:
    arena = arena_of(nexus, Pose2D(), Pose2D(0.0, 3.0))
    for tick in range(300):
        arena.place_person(1, Pose2D(-1.0 + 0.004 * tick), Twist2D(x=0.4))
        arena.advance([ROLL, STAND], STEPS)
    # the person's middle is at 0.2 m, and their body of 0.2 m before it
    assert arena.worlds[0].state().position[0] > 0.5
    assert arena.worlds[1].state().position[:2] == pytest.approx((0.0, 3.0), abs=1e-3)


def test_a_person_who_comes_back_is_where_they_are_said_to_be(nexus: Robot) -> None:
    world = World(nexus, PhysicsConfig(), Pose2D())
    for x in (0.6, 5.0):  # near, and away
        world.place_person(Pose2D(x=x), Twist2D())
        world.advance([0.0] * 4, STEPS)
    world.place_person(Pose2D(x=-0.6), Twist2D())
    for _ in range(60):
        world.advance([-12.0] * 4, STEPS)
    # 0.35 m back without them; their side is at -0.4 m, and the robot's rear 0.2 m behind it
    assert world.state().position[0] == pytest.approx(-0.2, abs=0.02)


def test_persons_walk_through_each_other(nexus: Robot) -> None:
    arena = arena_of(nexus, Pose2D(), Pose2D(0.0, 3.0))
    for _ in range(2):
        arena.place_person(0, Pose2D(0.45), Twist2D())
        arena.place_person(1, Pose2D(0.45, 0.1), Twist2D())
        arena.advance([STAND, STAND], STEPS)
    assert math.dist(arena.worlds[0].state().position, (0.0, 0.0, 0.0)) < 1e-3


def test_twice_the_same_meeting_gives_the_same_to_the_bit(nexus: Robot) -> None:
    def meeting() -> list[list[WorldState]]:
        arena = arena_of(nexus, Pose2D(), Pose2D(1.0, 0.05, 3.0), Pose2D(1.0, 1.0, -1.5))
        return drive(arena, 250, FORWARD, FORWARD, FORWARD)

    assert meeting() == meeting()


def test_robots_of_different_rollers_can_not_share_a_ground(nexus: Robot) -> None:
    slippery = replace(nexus, rollers=replace(nexus.rollers, contact_friction=0.5))
    with pytest.raises(UnsupportedError, match=r"same rollers\.contact_friction"):
        Arena([(nexus, Pose2D()), (slippery, Pose2D(2.0))], PhysicsConfig())


def test_robots_of_two_sizes_push_each_other(nexus: Robot) -> None:
    arena = Arena([(nexus, Pose2D()), (load_robot("artbul"), Pose2D(0.8))], PhysicsConfig())
    states = drive(arena, 350, FORWARD, BRAKE)
    assert speeds(states) == pytest.approx([0.3, 0.3], rel=JUDDER)
