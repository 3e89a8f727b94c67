"""Physics replaced by nothing: what is left of a run is services and messages.

Used through `programs.physics = "…/null_physics.py:NullPhysics"`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import WHEEL_JOINTS, WHEELS, Robot, roller_joint
from mecazen_physics.arena import Arena
from mecazen_physics.service import PhysicsService
from mecazen_physics.world import WheelCommand, WorldState


class NullWorld:
    """A robot that moves by the ideal equations, in the place of a `World`.

    Its rollers stand still, but at numbers with all their digits: messages are as long as
    real ones.
    """

    def __init__(self, robot: Robot, dt_s: float, start: Pose2D) -> None:
        rollers = [
            roller_joint(wheel, index) for wheel in WHEELS for index in range(robot.rollers.count)
        ]
        self.joint_names = (*WHEEL_JOINTS, *rollers)
        self._radius = robot.wheels.radius_m
        self._lever = robot.half_wheelbase + robot.half_track
        self._dt_s = dt_s
        self._pose = start
        self._numbers = [math.sqrt(2.0 + index) for index in range(len(rollers))]
        self._state = self._make_state(0.0, Twist2D(), [0.0] * len(WHEELS), [0.0] * len(WHEELS))

    def advance(self, command: Sequence[float], steps: int) -> None:
        """Move with wheels that turn as commanded [rad/s]."""
        elapsed = steps * self._dt_s
        fl, fr, rl, rr = command
        twist = Twist2D(
            (fl + fr + rl + rr) * self._radius / 4,
            (-fl + fr + rl - rr) * self._radius / 4,
            (-fl + fr - rl + rr) * self._radius / 4 / self._lever,
        )
        self._pose = self._pose.integrate(twist, elapsed)
        angles = [
            angle + speed * elapsed
            for angle, speed in zip(self._state.joint_position, command, strict=False)
        ]
        self._state = self._make_state(self._state.time + elapsed, twist, angles, command)

    def state(self) -> WorldState:
        """Return the present state."""
        return self._state

    def _make_state(
        self, time: float, twist: Twist2D, angles: Sequence[float], speeds: Sequence[float]
    ) -> WorldState:
        x, y, yaw = self._pose
        return WorldState(
            time=time,
            position=(x, y, 0.0),
            orientation=(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)),
            linear=(twist.x, twist.y, 0.0),
            angular=(0.0, 0.0, twist.yaw),
            joint_position=[*angles, *self._numbers],
            joint_velocity=[*speeds, *self._numbers],
            joint_effort=[*speeds, *self._numbers],
        )


class NullArena:
    """Robots that meet nobody, in the place of an `Arena`."""

    def __init__(self, worlds: Sequence[NullWorld]) -> None:
        self.worlds = worlds

    def advance(self, commands: Sequence[WheelCommand], steps: int) -> None:
        """Move each as commanded."""
        for world, command in zip(self.worlds, commands, strict=True):
            world.advance(command.values, steps)

    def place_person(self, number: int, pose: Pose2D, velocity: Twist2D) -> None:
        """Take no notice: there is nobody to touch."""


class NullPhysics(PhysicsService):
    """The physics service with nothing to simulate."""

    def make_arena(self) -> Arena:
        """Return the null arena: it has all of an arena that the service uses here."""
        parts = [self.scenario.of(name) for name in self.scenario.names]
        dt_s = self.config.dt_s
        worlds = [NullWorld(part.robot, dt_s, part.start.pose) for part in parts]
        return cast(Arena, NullArena(worlds))
