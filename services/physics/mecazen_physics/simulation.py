"""The robots of a scenario: each simulated separately, or together with robots it may touch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.geometry import Pose2D
from mecazen.robot import Robot
from mecazen.wheels import WheelCommand

from mecazen_physics.footprint import CLEARANCE_M, HORIZON_S
from mecazen_physics.people import MovingPerson
from mecazen_physics.robot import HYSTERESIS, SimulatedRobot
from mecazen_physics.world import UnsupportedError


class Simulation:
    """Robots, initially at rest at their start poses, and their surroundings.

    A robot that is far from all others is simulated in a separate DART world, and its motion is
    bit-identical to that without other robots. Robots that are close to each other are simulated in
    the world of the first of them. Two simulations with the same arguments and commands have
    bit-identical states. Start poses are those of base_link in the world frame.
    """

    def __init__(
        self,
        robots: Sequence[tuple[Robot, Pose2D]],
        physics: PhysicsConfig,
        world: WorldConfig = WorldConfig(),  # noqa: B008 - immutable
    ) -> None:
        self.robots = [SimulatedRobot(robot, start, physics, world) for robot, start in robots]
        if len({robot.rollers.contact_friction for robot, _ in robots}) > 1:
            raise UnsupportedError(
                "several robots need the same rollers.contact_friction: they share a ground"
            )
        self._horizon = max(1, round(HORIZON_S / physics.dt_s))
        """Maximum number of steps between two checks of the robots' surroundings."""
        fastest = max(robot.max_speed for robot in self.robots)
        diameter = 2.0 * max(robot.footprint().radius for robot in self.robots)
        self._far = diameter + HYSTERESIS * (CLEARANCE_M + 2.0 * fastest * HORIZON_S)
        """Robots whose centres are farther apart are not close to each other [m]."""
        self._coupled: set[int] = set()
        """The numbers of the robots that are simulated together."""
        self._groups = [[number] for number in range(len(robots))]
        """The numbers of the robots of each group; the coupled ones are the last."""

    def advance(self, commands: Sequence[WheelCommand], steps: int) -> None:
        """Simulate `steps` steps of `dt_s`, with a command for each robot."""
        while steps > 0:
            self._update_groups()
            chunk = min(steps, self._horizon)
            for group in self._groups:
                robots, orders = [self.robots[n] for n in group], [commands[n] for n in group]
                _advance_group(robots, orders, chunk)
            steps -= chunk

    def _update_groups(self) -> None:
        """Couple the robots that come close to each other, and decouple those that are far again.

        A broad phase on centre distance avoids the footprint distance for most pairs.
        """
        centres = [robot.state.position[:2] for robot in self.robots]
        coupled = set[int]()
        for pair in combinations(range(len(centres)), 2):
            left, right = pair
            if math.dist(centres[left], centres[right]) <= self._far:
                first, second = self.robots[left].footprint(), self.robots[right].footprint()
                margin = HYSTERESIS if self._coupled.issuperset(pair) else 1.0
                if first.gap(second) <= margin * first.travel(second):
                    coupled.update(pair)
        if coupled != self._coupled:
            self._coupled = coupled
            apart = [[number] for number in range(len(centres)) if number not in coupled]
            self._groups = apart + ([sorted(coupled)] if coupled else [])
            for group in self._groups:
                world = self.robots[group[0]].home
                for number in group:
                    self.robots[number].share(world, alone=len(group) == 1)


def _advance_group(
    robots: Sequence[SimulatedRobot], commands: Sequence[WheelCommand], steps: int
) -> None:
    """Simulate `steps` steps of one robot, or of several in the world that they share."""
    world = robots[0].body.world
    people: dict[int, MovingPerson] = {}
    for robot, command in zip(robots, commands, strict=True):
        robot.look_around()
        robot.command(command)
        people |= robot.close_people
    world.set_surroundings(people, obstacles=any(robot.near_obstacle for robot in robots))
    world.choose_solver(alone=robots[0].isolated, robots=len(robots))
    for _ in range(steps):
        for robot in robots:
            robot.before_step()
        world.step(False)
        for robot in robots:
            robot.after_step()
    for robot in robots:
        robot.finish(steps)
