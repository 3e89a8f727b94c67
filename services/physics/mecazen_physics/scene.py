"""The robot and what it can touch in a world of DART, every roller a body."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import dartpy as dart
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS, Robot

from mecazen_physics import bodies
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.errors import UnsupportedError
from mecazen_physics.reach import Reach

BASE_DOFS = 7
"""Of the base in space, and of its front axle."""
_PROBE_DEPTH = 1e-4


class Motion(NamedTuple):
    """Positions and velocities of the robot in DART's coordinates.

    Of the base a rotation vector [rad], base_link's origin [m] and the front axle's angle
    [rad], and their rates, in world axes [rad/s, m/s, rad/s]; of the joints, wheels and then
    every roller, [rad] and [rad/s].
    """

    base_position: list[float]
    base_velocity: list[float]
    joint_position: list[float]
    joint_velocity: list[float]


class Scene:
    """The robot at rest at `start`, with every roller, and what surrounds it.

    `wheels` are the joints that motors drive; `step(False)` simulates a step of `dt_s`.

    Raises:
        UnsupportedError: if dartpy does not simulate the rollers' shape, or an obstacle is so
            low that the robot could drive onto it.
    """

    _NEAR = False

    def __init__(self, robot: Robot, config: PhysicsConfig, start: Pose2D) -> None:
        self._config = config
        self._world = dart.simulation.World()
        self._world.setTimeStep(config.dt_s)
        self._world.setGravity(_gravity(config))
        self._world.setCollisionDetector(dart.simulation.BULLET)
        # A body that DART has put to sleep ignores a person who walks into it.
        sleep = self._world.getDeactivationOptions()
        sleep.mEnabled = False
        self._world.setDeactivationOptions(sleep)
        obstacles = () if self._NEAR else config.obstacles
        self._surroundings = bodies.build_surroundings(robot, config, obstacles)
        self.robot, self._joints = bodies.build_robot(robot, config, start, near=self._NEAR)
        self.wheels = self._joints[: len(WHEELS)]
        self.person: Any = None
        self._servo: bool | None = None
        self._world.addSkeleton(self._surroundings)
        self._world.addSkeleton(self.robot)
        self.step = self._world.step
        self._check_supported()
        rollers = [joint.getChildBodyNode() for joint in self._joints[len(WHEELS) :]]
        self._reach = Reach(robot, rollers)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints' names, in the order of `Motion`."""
        return tuple(joint.getName() for joint in self._joints)

    def use_servo(self, *, servo: bool) -> None:
        """Take the wheels' commands as speeds [rad/s] or as torques [N·m]."""
        if servo != self._servo:
            self._servo = servo
            for wheel in self.wheels:
                wheel.setActuatorType(dart.dynamics.SERVO if servo else dart.dynamics.FORCE)

    def prepare(self, speeds: Sequence[tuple[float, float]], steps: int, *, alone: bool) -> int:
        """Return how many of `steps` steps can be simulated before the next call.

        Args:
            speeds: The lowest and the highest that each wheel should have in them [rad/s].
            steps: At least 1.
            alone: Whether the robot stands upright with nothing near it.
        """
        angles = [wheel.getPosition(0) for wheel in self.wheels]
        fastest = [max(-low, high) for low, high in speeds]
        self._reach.update(angles, fastest, steps * self._config.dt_s, alone=alone)
        return steps

    def speeds(self) -> list[float]:
        """Return the wheels' speeds [rad/s]."""
        return [wheel.getVelocity(0) for wheel in self.wheels]

    def settle(self, steps: int) -> None:
        """Take note of the `steps` steps that were simulated."""

    def read(self) -> Motion:
        """Return the present motion."""
        position = self.robot.getPositions().tolist()
        velocity = self.robot.getVelocities().tolist()
        return Motion(
            position[:BASE_DOFS],
            velocity[:BASE_DOFS],
            position[BASE_DOFS:],
            velocity[BASE_DOFS:],
        )

    def write(self, motion: Motion) -> None:
        """Put the robot into `motion`."""
        self.robot.setPositions(motion.base_position + motion.joint_position)
        self.robot.setVelocities(motion.base_velocity + motion.joint_velocity)

    def place_person(self, x: float, y: float, velocity: Sequence[float]) -> None:
        """Put the person at (x, y) [m], moving with `velocity` (2,) [m/s], all in the world."""
        if self.person is None:
            self.person = self._add_person()
        self.person.setPositions([x, y])
        self.person.setCommands(velocity)

    def _add_person(self) -> Any:
        person, body = bodies.build_person(self._config.person)
        # Neither the ground nor an obstacle stops the person: they go where they are told.
        collisions = self._world.getConstraintSolver().getCollisionOption().collisionFilter
        for index in range(self._surroundings.getNumBodyNodes()):
            collisions.addBodyNodePairToBlackList(body, self._surroundings.getBodyNode(index))
        self._world.addSkeleton(person)
        return person

    def _check_supported(self) -> None:
        """Press the robot a little into the ground and see that its four rollers feel it.

        The DART detector knows no contact of such a shape, FCL puts a sphere in its place;
        both without an error.
        """
        detector = self._world.getCollisionDetector()
        group = detector.createCollisionGroup()
        group.addShapeFramesOf(self._surroundings.getBodyNode(0))
        group.addShapeFramesOf(self.robot)
        result = dart.collision.CollisionResult()
        root = self.robot.getRootJoint()
        placed = root.getPositions()
        root.setPositions(placed - [0.0, 0.0, 0.0, 0.0, 0.0, _PROBE_DEPTH])
        group.collide(self._world.getConstraintSolver().getCollisionOption(), result)
        root.setPositions(placed)
        depths = [contact.penetrationDepth for contact in result.getContacts()]
        wrong = [depth for depth in depths if abs(depth - _PROBE_DEPTH) > 0.1 * _PROBE_DEPTH]
        if wrong or len(depths) != len(WHEELS):
            raise UnsupportedError(
                f"dartpy's {type(detector).__name__} does not simulate the rollers' shape: four "
                f"of them {_PROBE_DEPTH} m deep in the ground have contacts of depth {depths} m"
            )


def _gravity(config: PhysicsConfig) -> list[float]:
    slope, heading = math.radians(config.slope_deg), math.radians(config.slope_heading_deg)
    along = -bodies.GRAVITY * math.sin(slope)
    return [along * math.cos(heading), along * math.sin(heading), -bodies.GRAVITY * math.cos(slope)]
