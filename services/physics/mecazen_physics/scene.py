"""The robot in a world of DART, every roller a body; and what it can touch there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

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

Drive = Literal["speed", "servo", "torque"]
"""What the wheels' motors hold: a speed, whatever it takes; a speed within their torque; a torque.

A speed that is held whatever it takes belongs to DART's forward dynamics. A servo is four more
constraints, a quarter of a step's time, and does the same as long as its limit is not reached.
"""
_ACTUATORS = {
    "speed": dart.dynamics.VELOCITY,
    "servo": dart.dynamics.SERVO,
    "torque": dart.dynamics.FORCE,
}


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


class Walking(NamedTuple):
    """A person in the world frame: where they are [m], and their velocity (2,) [m/s]."""

    x: float
    y: float
    velocity: tuple[float, float]


class Stage:
    """A world of DART with the ground, the obstacles, and whoever comes near.

    `step(False)` simulates a step of `dt_s`.

    Raises:
        UnsupportedError: if an obstacle is so low that `robot` could drive onto it.
    """

    def __init__(self, robot: Robot, config: PhysicsConfig, *, bare: bool = False) -> None:
        self._person = config.person
        self.world = dart.simulation.World()
        self.world.setTimeStep(config.dt_s)
        self.world.setGravity(_gravity(config))
        self.world.setCollisionDetector(dart.simulation.BULLET)
        # A body that DART has put to sleep ignores a person who walks into it.
        sleep = self.world.getDeactivationOptions()
        sleep.mEnabled = False
        self.world.setDeactivationOptions(sleep)
        obstacles = () if bare else config.obstacles
        self.surroundings = bodies.build_surroundings(robot, config, obstacles)
        self.world.addSkeleton(self.surroundings)
        self.step = self.world.step
        self._known: dict[int, tuple[Any, Any]] = {}
        self._present: set[int] = set()

    def show(self, people: Mapping[int, Walking]) -> None:
        """Have these people here, by their numbers, and nobody else."""
        if people.keys() == self._present:
            return
        for number in self._present - people.keys():
            self.world.removeSkeleton(self._known[number][0])
        for number in sorted(people.keys() - self._present):
            if number not in self._known:
                self._know(number)
            self.world.addSkeleton(self._known[number][0])
            self._place(number, people[number])
        self._present = set(people)

    def place_person(self, number: int, walking: Walking) -> None:
        """Put a person elsewhere, if they are here."""
        if number in self._present:
            self._place(number, walking)

    def _place(self, number: int, walking: Walking) -> None:
        person, _ = self._known[number]
        person.setPositions([walking.x, walking.y])
        person.setCommands(walking.velocity)

    def _know(self, number: int) -> None:
        person, body = bodies.build_person(self._person)
        person.setName(f"person_{number}")
        # Neither the ground, nor an obstacle, nor another stops the person: they go where they
        # are told.
        collisions = self.world.getConstraintSolver().getCollisionOption().collisionFilter
        for index in range(self.surroundings.getNumBodyNodes()):
            collisions.addBodyNodePairToBlackList(body, self.surroundings.getBodyNode(index))
        for _, other in self._known.values():
            collisions.addBodyNodePairToBlackList(body, other)
        self._known[number] = person, body


class Scene:
    """The robot at rest at `start`, with every roller, on a stage.

    `wheels` are the joints that motors drive.

    Raises:
        UnsupportedError: if dartpy does not simulate the rollers' shape, or as of `Stage`.
    """

    _NEAR = False

    def __init__(self, robot: Robot, config: PhysicsConfig, start: Pose2D) -> None:
        self._config = config
        self.stage = Stage(robot, config, bare=self._NEAR)
        self.robot, self._joints = bodies.build_robot(robot, config, start, near=self._NEAR)
        self.wheels = self._joints[: len(WHEELS)]
        self._hubs = [wheel.getChildBodyNode() for wheel in self.wheels]
        self._drive: Drive = "torque"
        self.stage.world.addSkeleton(self.robot)
        self._check_supported()
        rollers = [joint.getChildBodyNode() for joint in self._joints[len(WHEELS) :]]
        self._reach = Reach(robot, rollers)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints' names, in the order of `Motion`."""
        return tuple(joint.getName() for joint in self._joints)

    def enter(self, stage: Stage) -> None:
        """Go on, as it moves, on another stage."""
        if stage is not self.stage:
            self.stage.world.removeSkeleton(self.robot)
            stage.world.addSkeleton(self.robot)
            self.stage = stage

    def use(self, drive: Drive) -> None:
        """Take the wheels' commands as speeds [rad/s] or as torques [N·m]."""
        if drive != self._drive:
            self._drive = drive
            for wheel in self.wheels:
                wheel.setActuatorType(_ACTUATORS[drive])

    def torques(self) -> list[float]:
        """Return what the wheels' motors gave in the last step [N·m]."""
        if self._drive == "speed":
            return [float(hub.getBodyForce()[1]) for hub in self._hubs]
        if self._drive == "servo":
            # DART's servo is a velocity constraint; its torque is that constraint's impulse.
            dt = self._config.dt_s
            return [wheel.getConstraintImpulse(0) / dt for wheel in self.wheels]
        return [wheel.getCommand(0) for wheel in self.wheels]

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

    def _check_supported(self) -> None:
        """Press the robot a little into the ground and see that its four rollers feel it.

        The DART detector knows no contact of such a shape, FCL puts a sphere in its place;
        both without an error.
        """
        world = self.stage.world
        detector = world.getCollisionDetector()
        group = detector.createCollisionGroup()
        group.addShapeFramesOf(self.stage.surroundings.getBodyNode(0))
        group.addShapeFramesOf(self.robot)
        result = dart.collision.CollisionResult()
        root = self.robot.getRootJoint()
        placed = root.getPositions()
        root.setPositions(placed - [0.0, 0.0, 0.0, 0.0, 0.0, _PROBE_DEPTH])
        group.collide(world.getConstraintSolver().getCollisionOption(), result)
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
