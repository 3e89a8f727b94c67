"""Robots in the simulated world, for the tests of physics: commands in, states out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mecazen.geometry import Pose2D, Twist2D
from mecazen.robot import Robot
from mecazen.world import WorldConfig
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.motors import WheelCommand
from mecazen_physics.state import RobotState
from mecazen_physics.world import World

STEPS = 10  # of 1 ms in a control period


def world_of(robots: Sequence[tuple[Robot, Pose2D]], **settings: Any) -> World:
    """A world with settings of `[physics]` and of `[world]`."""
    outside = {name: settings.pop(name) for name in WorldConfig.__struct_fields__ & settings.keys()}
    return World(robots, PhysicsConfig(**settings), WorldConfig(**outside))


class Rig:
    """A single robot; settings are those of `[physics]` and of `[world]`."""

    def __init__(self, robot: Robot, start: Pose2D = Pose2D(), **settings: Any) -> None:  # noqa: B008
        self.world = world_of([(robot, start)], **settings)
        (self.robot,) = self.world.robots
        self.joint_names = self.robot.joint_names

    @property
    def body(self) -> Any:
        return self.robot.body

    def state(self) -> RobotState:
        return self.robot.state()

    def advance(self, speeds: Sequence[float], steps: int = STEPS) -> RobotState:
        """Turn the wheels at `speeds` [rad/s]; return the state after `steps`."""
        self.world.advance([WheelCommand(speeds)], steps)
        return self.state()

    def advance_effort(self, torques: Sequence[float], steps: int = STEPS) -> RobotState:
        """Turn the wheels with `torques` [N·m]; return the state after `steps`."""
        self.world.advance([WheelCommand(torques, is_effort=True)], steps)
        return self.state()

    def drive(self, speeds: Sequence[float], seconds: float) -> list[RobotState]:
        """The states at every tick; the first half second brings the wheels up to `speeds`."""
        return [
            self.advance([min(1.0, tick / 50) * speed for speed in speeds])
            for tick in range(round(seconds * 100))
        ]

    def place_person(self, pose: Pose2D, velocity: Twist2D = Twist2D()) -> None:  # noqa: B008
        self.world.place_person(0, pose, velocity)
