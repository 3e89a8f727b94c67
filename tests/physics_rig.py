"""Robots in the simulated world, for the tests of physics: commands in, states out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.links import robot_links
from mecazen.robot import Robot
from mecazen.rollers import Roller
from mecazen.wheels import WheelCommand
from mecazen_physics.people import MovingPerson
from mecazen_physics.robot import SimulatedRobot
from mecazen_physics.simulation import Simulation
from mecazen_physics.state import RobotState

STEPS = 10  # of 1 ms in a control period


def simulation_of(robots: Sequence[tuple[Robot, Pose2D]], **settings: Any) -> Simulation:
    """A world with settings of `[physics]` and of `[world]`; a step is 1 ms if not said."""
    settings.setdefault("dt_s", 0.001)
    outside = {name: settings.pop(name) for name in WorldConfig.__struct_fields__ & settings.keys()}
    return Simulation(robots, PhysicsConfig(**settings), WorldConfig(**outside))


def wheel_speeds(robot: Robot, twist: Twist2D) -> list[float]:
    """The ideal equations, wheels in the order of `WHEELS` [rad/s]."""
    aside = (1.0 if robot.rollers.arrangement == "X" else -1.0) / math.tan(
        math.radians(robot.rollers.angle_deg)
    )
    turn = (robot.half_track + aside * robot.half_wheelbase) * twist.yaw
    x, y = twist.x, aside * twist.y
    return [
        speed / robot.wheels.radius_m
        for speed in (x - y - turn, x + y + turn, x + y - turn, x - y + turn)
    ]


def masses(robot: Robot) -> tuple[float, float]:
    """The robot's mass [kg], and what its turning wheels add to it as they roll [kg]."""
    roller, hub = Roller.from_robot(robot), robot_links(robot)[0]
    count = robot.rollers.count
    rest = robot.base.mass_kg + robot.camera.mass_kg + robot.lidar.mass_kg
    mass = rest + 4 * (robot.wheels.hub_mass_kg + count * roller.mass)
    # A roller off the ground turns with the wheel but for the turn about its own free axis.
    across = roller.inertia[0] * math.sin(roller.angle) ** 2
    about_axle = hub.moments[1] + count * (roller.mass * roller.axis_distance**2 + across)
    return mass, 4 * about_axle / robot.wheels.radius_m**2


class Rig:
    """A single robot; settings are those of `[physics]` and of `[world]`."""

    def __init__(self, robot: Robot, start: Pose2D = Pose2D(), **settings: Any) -> None:  # noqa: B008
        self.world = simulation_of([(robot, start)], **settings)
        (self.robot,) = self.world.robots
        self.joint_names = self.robot.joint_names

    @property
    def body(self) -> Any:
        return self.robot.body

    def state(self) -> RobotState:
        return self.robot.state

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

    def throw(self, x: float, y: float = 0.0) -> None:
        """Give the base a velocity along the axes of world [m/s]."""
        throw(self.robot, x, y)

    def place_person(self, pose: Pose2D, velocity: Twist2D = Twist2D()) -> None:  # noqa: B008
        for robot in self.world.robots:
            robot.place_person(0, MovingPerson.upright(pose, velocity))


def throw(robot: SimulatedRobot, x: float, y: float = 0.0) -> None:
    """Give a robot's base a velocity along the axes of world [m/s]."""
    root = robot.body.skeleton.getRootJoint()
    velocity = root.getVelocities()
    velocity[3:5] = rotate(x, y, -robot.body.world.heading)
    root.setVelocities(velocity)
