"""Physics without dynamics: what remains of a run is services and messages.

Used through `programs.physics = "…/null_physics.py:NullPhysics"`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import WHEEL_JOINTS, WHEELS, Robot, roller_joint
from mecazen_controller.kinematics import MecanumKinematics, WheelSpeeds
from mecazen_physics.motors import WheelCommand
from mecazen_physics.node import PhysicsWorld
from mecazen_physics.people import MovingPerson
from mecazen_physics.simulation import Simulation
from mecazen_physics.state import RobotState


class NullSimulation:
    """One robot that moves by the ideal equations, in place of a `Simulation` and its robot.

    Its rollers are at rest, at numbers with all their digits: messages are as long as real ones.
    """

    def __init__(self, robot: Robot, dt_s: float, start: Pose2D) -> None:
        self.robots = [self]
        rollers = [roller_joint(wheel, i) for wheel in WHEELS for i in range(robot.rollers.count)]
        self.joint_names = (*WHEEL_JOINTS, *rollers)
        self._kinematics = MecanumKinematics.of(robot)
        self._dt_s = dt_s
        self._time, self._pose, self._twist = 0.0, start, Twist2D()
        self._angles = self._speeds = [0.0] * len(WHEELS)
        self._numbers = [math.sqrt(2.0 + index) for index in range(len(rollers))]

    def advance(self, commands: Sequence[WheelCommand], steps: int) -> None:
        """Move with wheels that turn as commanded [rad/s]."""
        (command,) = commands
        elapsed = steps * self._dt_s
        self._time += elapsed
        self._speeds = list(command.values)
        self._twist = self._kinematics.forward(WheelSpeeds(*self._speeds))
        self._pose = self._pose.integrate(self._twist, elapsed)
        self._angles = [
            a + speed * elapsed for a, speed in zip(self._angles, self._speeds, strict=True)
        ]

    @property
    def state(self) -> RobotState:
        x, y, yaw = self._pose
        return RobotState(
            time=self._time,
            position=(x, y, 0.0),
            orientation=(0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)),
            linear=(self._twist.x, self._twist.y, 0.0),
            angular=(0.0, 0.0, self._twist.yaw),
            joint_position=[*self._angles, *self._numbers],
            joint_velocity=[*self._speeds, *self._numbers],
            joint_effort=[*self._speeds, *self._numbers],
        )

    def place_person(self, number: int, person: MovingPerson) -> None:
        """Do nothing: there are no contacts."""


class NullPhysics(PhysicsWorld):
    """The node of one robot without dynamics."""

    def make_simulation(self) -> Simulation:
        """Return the null simulation, which has all that its node uses of one."""
        scenario = self.scenario
        simulation = NullSimulation(scenario.robot, self.config.dt_s, scenario.start.pose)
        return cast(Simulation, simulation)
