"""Physics replaced by nothing: what is left of a run is services and messages.

Used through `programs.physics = "…/null_physics.py:NullPhysics"`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import WHEEL_JOINTS, WHEELS, Robot, roller_joint
from mecazen_physics.motors import WheelCommand
from mecazen_physics.service import PhysicsService
from mecazen_physics.state import RobotState
from mecazen_physics.world import World


class NullRobot:
    """A robot that moves by the ideal equations, in the place of a `DartRobot`.

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

    def state(self) -> RobotState:
        """Return the present state."""
        return self._state

    def _make_state(
        self, time: float, twist: Twist2D, angles: Sequence[float], speeds: Sequence[float]
    ) -> RobotState:
        x, y, yaw = self._pose
        return RobotState(
            time=time,
            position=(x, y, 0.0),
            orientation=(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)),
            linear=(twist.x, twist.y, 0.0),
            angular=(0.0, 0.0, twist.yaw),
            joint_position=[*angles, *self._numbers],
            joint_velocity=[*speeds, *self._numbers],
            joint_effort=[*speeds, *self._numbers],
        )


class NullWorld:
    """Robots that touch nothing, in the place of a `World`."""

    def __init__(self, robots: Sequence[NullRobot]) -> None:
        self.robots = robots

    def advance(self, commands: Sequence[WheelCommand], steps: int) -> None:
        """Move each as commanded."""
        for robot, command in zip(self.robots, commands, strict=True):
            robot.advance(command.values, steps)

    def place_person(self, number: int, pose: Pose2D, velocity: Twist2D) -> None:
        """Take no notice: there is nobody to touch."""


class NullPhysics(PhysicsService):
    """The physics service with nothing to simulate."""

    def make_world(self) -> World:
        """Return the null world: it has all of a world that the service uses here."""
        parts = [self.scenario.of(name) for name in self.scenario.names]
        dt_s = self.config.dt_s
        robots = [NullRobot(part.robot, dt_s, part.start.pose) for part in parts]
        return cast(World, NullWorld(robots))
