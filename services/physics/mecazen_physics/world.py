"""Robots in one world: each simulated by itself, or together with those that it may touch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.geometry import Pose2D
from mecazen.robot import Robot

from mecazen_physics.contacts import CLEARANCE_M, HORIZON_S, horizon_steps
from mecazen_physics.dart_robot import HYSTERESIS, Check, DartRobot
from mecazen_physics.dart_world import DartWorld
from mecazen_physics.errors import UnsupportedError
from mecazen_physics.motors import Push, WheelCommand
from mecazen_physics.people import MovingPerson

MAX_SWEEPS = 25
"""Of the cone's solver where robots are close to each other, for which 100 are DART's default.

Where wheels strain it rarely converges: two robots that strafe take half the time, and are 0.1 mm
from where 1000 sweeps bring them, after 0.26 m.
"""
_UNLIMITED = 10**9
"""More steps than are ever asked for."""


class World:
    """Robots, each at rest at its start, and what surrounds them.

    A robot that is far from all others is simulated by itself and moves as if there were no
    other, to the last bit. Those that are close to another are simulated together. Two worlds of
    the same arguments that are advanced alike have the same states to the last bit.

    Args:
        robots: Each robot, and where its base_link starts in the world frame.
        physics: How they are simulated.
        world: What surrounds them.

    Raises:
        UnsupportedError: as of `DartRobot`, or if the robots' rollers have not all the same
            friction.
    """

    def __init__(
        self,
        robots: Sequence[tuple[Robot, Pose2D]],
        physics: PhysicsConfig,
        world: WorldConfig = WorldConfig(),  # noqa: B008 - immutable
    ) -> None:
        self.robots = [DartRobot(robot, start, physics, world) for robot, start in robots]
        self._horizon = horizon_steps(physics)
        first = robots[0][0]
        if len({robot.rollers.contact_friction for robot, _ in robots}) > 1:
            raise UnsupportedError(
                "several robots need the same rollers.contact_friction: they share a ground"
            )
        self._shared: DartWorld | None = None
        if len(robots) > 1:
            self._shared = DartWorld(first, physics, world, max_sweeps=MAX_SWEEPS)
        fastest = max(robot.max_speed for robot in self.robots)
        self._approach = 2.0 * physics.dt_s * fastest
        """The most by which two robots come closer to each other in a step [m]."""
        diameter = 2.0 * max(robot.footprint().radius for robot in self.robots)
        self._far = diameter + HYSTERESIS * (CLEARANCE_M + 2.0 * fastest * HORIZON_S)
        """Robots whose centres are farther apart are not close to each other [m]."""
        self._coupled: set[int] = set()
        """The numbers of the robots that are simulated together."""
        self._groups = [[number] for number in range(len(robots))]
        """The numbers of the robots of each group; the coupled ones are the last."""
        self._clear_steps = 0
        """For how many steps no two robots that are far apart can come close."""

    def advance(self, commands: Sequence[WheelCommand], steps: int) -> None:
        """Simulate `steps` steps of `dt_s`, with a command for each robot.

        Raises:
            DivergedError: if a state is no longer one of a robot on the ground.
        """
        left = steps
        while left > 0:
            if self._coupled or self._clear_steps <= 0:
                self._clear_steps = self._update_groups()
            chunk = min(left, max(self._horizon, self._clear_steps))
            for group in self._groups:
                _advance_group([(self.robots[n], commands[n]) for n in group], chunk)
            left -= chunk
            self._clear_steps -= chunk

    def place_person(self, number: int, person: MovingPerson) -> None:
        """Put the person `number` into the world; each is always one with legs or without.

        They keep their velocity until placed again. No person is there before the first call.
        """
        for robot in self.robots:
            robot.place_person(number, person)

    def _update_groups(self) -> int:
        """Couple the robots that come close to each other, and decouple those that are far again.

        A broad phase on centre distance spares most pairs the distance of their footprints.

        Returns:
            For how many steps no other two can come close to each other.
        """
        if self._shared is None:
            return _UNLIMITED
        centres = [robot.state().position[:2] for robot in self.robots]
        coupled = set()
        clear = math.inf
        for one, other in combinations(range(len(centres)), 2):
            gap = math.dist(centres[one], centres[other]) - self._far
            if gap <= 0.0:
                first, second = self.robots[one].footprint(), self.robots[other].footprint()
                margin = HYSTERESIS if {one, other} <= self._coupled else 1.0
                gap = first.gap(second) - margin * first.travel(second)
            if gap <= 0.0:
                coupled |= {one, other}
            else:
                clear = min(clear, gap)
        for number in sorted(coupled ^ self._coupled):
            self.robots[number].share(self._shared if number in coupled else None)
        if coupled != self._coupled:
            self._coupled = coupled
            apart = [[number] for number in range(len(centres)) if number not in coupled]
            self._groups = apart + ([sorted(coupled)] if coupled else [])
        return int(min(clear / self._approach, _UNLIMITED))


def _advance_group(orders: Sequence[tuple[DartRobot, WheelCommand]], steps: int) -> None:
    """Simulate `steps` steps of one robot, or of several in the world that they share.

    Raises:
        DivergedError: if a state is no longer one of a robot on the ground.
    """
    left = steps
    while left > 0:
        people: dict[int, MovingPerson] = {}
        for robot, _ in orders:
            robot.update_contact_candidates()
            people |= robot.close_people
        world = orders[0][0].body.world
        world.set_present(people)
        chunk, pushes, checks = left, [], []
        for robot, command in orders:
            prepared = robot.prepare(command, left)
            chunk = min(chunk, prepared.steps)
            pushes += prepared.pushes
            checks.append(prepared.check)
        if not _simulate(world, pushes, checks, chunk):
            again = [robot.take_back(command, chunk) for robot, command in orders]
            world.use_exact_friction(exact=not world.aligned)
            pushes = [push for prepared in again for push in prepared.pushes]
            _simulate(world, pushes, [prepared.check for prepared in again], chunk)
        for robot, _ in orders:
            robot.settle(chunk)
        left -= chunk


def _simulate(
    world: DartWorld, pushes: Sequence[Push], checks: Sequence[Check], steps: int
) -> bool:
    """Simulate `steps` steps, and choose the solver of friction for the next ones.

    Returns:
        Whether all motors were within their torque, and all friction within its cone; if not,
        the steps are to be taken back.
    """
    step = world.step
    for _ in range(steps):
        for push in pushes:
            push()
        step(False)
        for check in checks:
            if not check():
                return False
    if world.aligned:
        return True
    was_exact, slips = world.is_exact, world.slips()
    world.use_exact_friction(exact=slips)
    return was_exact or not slips
