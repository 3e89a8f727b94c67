"""A world without physics: `programs.physics = "mecazen_tools.plane:Plane"`."""

from __future__ import annotations

import math

import numpy as np
from mecazen import messages as m
from mecazen.keys import GROUND_TRUTH, JOINT_COMMAND, JOINT_STATES
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.robot import WHEEL_JOINTS
from mecazen.wheels import MecanumKinematics, Watchdog, WheelCommand, WheelSpeeds

WHEEL_LAG_S = 0.02
"""Time constant of the wheels."""


class Plane(Node):
    """A plane on which the robot's wheels roll without slip, and nothing stops the robot."""

    def reset(self, seed: int) -> None:
        """Place the robot at the start, at rest."""
        self.pose, self.speeds = self.scenario.start.pose, np.zeros(4)
        self.kinematics = MecanumKinematics.from_robot(self.scenario.robot)
        self.watchdog = Watchdog(self.scenario)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Simulate the wheels for a tick."""
        joints = inputs.get(JOINT_COMMAND)
        command = self.watchdog.command(
            None if joints is None else WheelCommand(joints.velocity),
            inputs.age_s(JOINT_COMMAND),
            self.speeds.tolist(),
        )
        period_s = tick.period_s if tick.number else 0.0
        lag = 1.0 - math.exp(-period_s / WHEEL_LAG_S)
        self.speeds += lag * (np.array(command.values) - self.speeds)
        twist = self.kinematics.forward(WheelSpeeds(*self.speeds.tolist()))
        if tick.number:
            self.pose = self.pose.integrate(twist, tick.period_s)
        header = m.Header(stamp=tick.time)
        joints = m.JointState(header, WHEEL_JOINTS, velocity=tuple(self.speeds.tolist()))
        truth = m.planar_odometry(tick.time, "world", "base_link", self.pose, twist)
        return {JOINT_STATES: joints, GROUND_TRUTH: truth}
