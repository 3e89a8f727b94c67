"""Robots in one world: each by itself, and together those that may touch each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import Robot

from mecazen_physics.config import PhysicsConfig
from mecazen_physics.errors import UnsupportedError
from mecazen_physics.scene import Stage
from mecazen_physics.world import WheelCommand, World, advance_together, longest_chunk

NEAR_M = 0.2
"""Robots that are farther from each other do not touch before they look round again."""
_MANY = 10**9
"""More steps than are ever asked for."""


class Arena:
    """Robots, each at rest at its start, and what surrounds them.

    A robot that is far from all others is simulated by itself and moves as if there were no
    other, to the last bit. Those that are near another are simulated together, with all their
    rollers as bodies.

    Raises:
        UnsupportedError: as of `World`, or if the robots' rollers have not all the same friction.
    """

    def __init__(self, robots: Sequence[tuple[Robot, Pose2D]], config: PhysicsConfig) -> None:
        self.worlds = [World(robot, config, start) for robot, start in robots]
        self._longest = longest_chunk(config)
        first = robots[0][0]
        if {robot.rollers.contact_friction for robot, _ in robots} != {
            first.rollers.contact_friction
        }:
            raise UnsupportedError(
                "robots that can meet need the same rollers.contact_friction: they share a ground"
            )
        self._stage = Stage(first, config) if len(robots) > 1 else None
        self._closing = 2.0 * config.dt_s * max(world.fastest for world in self.worlds)
        """No two robots come nearer to each other in a step [m]."""
        self._circles = 2.0 * max(world.footprint().radius for world in self.worlds)
        """Robots whose middles are farther apart than this do not touch, however they stand [m]."""
        self._met: set[int] = set()

    def advance(self, commands: Sequence[WheelCommand], steps: int) -> None:
        """Simulate `steps` steps of `dt_s`, with a command for each robot; see `World`.

        Raises:
            DivergedError: if a state is no longer one of a robot on the ground.
        """
        left = steps
        while left > 0:
            chunk = min(left, max(self._longest, self._look_round()))
            met = sorted(self._met)
            groups = [[number] for number in range(len(self.worlds)) if number not in self._met]
            for group in [*groups, *([met] if met else [])]:
                worlds = [self.worlds[number] for number in group]
                advance_together(worlds, [commands[number] for number in group], chunk)
            left -= chunk

    def place_person(self, number: int, pose: Pose2D, velocity: Twist2D) -> None:
        """Put the person `number` somewhere; see `World`."""
        for world in self.worlds:
            world.place_person(pose, velocity, number)

    def _look_round(self) -> int:
        """Let those meet that come near each other, and part that are far again.

        Returns:
            For how many steps nobody else can come near another.
        """
        if len(self.worlds) == 1:
            return _MANY
        places = [world.state().position[:2] for world in self.worlds]
        met = set()
        clear = math.inf
        for one, other in combinations(range(len(places)), 2):
            # It takes more to part: nothing goes back and forth at the border.
            near = (1.5 if {one, other} <= self._met else 1.0) * NEAR_M
            gap = math.dist(places[one], places[other]) - self._circles - near
            if gap <= 0.0:
                gap = self.worlds[one].footprint().gap(self.worlds[other].footprint()) - near
            if gap <= 0.0:
                met |= {one, other}
            else:
                clear = min(clear, gap)
        for number in sorted(met ^ self._met):
            self.worlds[number].share(self._stage if number in met else None)
        self._met = met
        return int(min(clear / self._closing, _MANY))
