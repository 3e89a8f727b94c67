"""The robot's body in DART: what its models have in common, and the one of all rollers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Literal

import dartpy as dart
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS, Robot
from mecazen.world import WorldConfig

from mecazen_physics import bodies
from mecazen_physics.config import PhysicsConfig
from mecazen_physics.contacts import ContactCandidates
from mecazen_physics.dart_world import DartWorld
from mecazen_physics.model import full_tree
from mecazen_physics.state import Motion

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


class RobotBody(ABC):
    """A robot in a world of DART, as one of the two models of its rollers.

    Args:
        world: Where the robot is; isolated, it stays there.
        skeleton: The robot's.
        joints: Of its wheels and of those of its rollers that are bodies.
        dt: The length of a step [s].

    Raises:
        UnsupportedError: if dartpy does not simulate the rollers' shape.
    """

    def __init__(self, world: DartWorld, skeleton: Any, joints: Sequence[Any], dt: float) -> None:
        self.world, self.skeleton = world, skeleton
        self.wheels = joints[: len(WHEELS)]
        """The joints that motors drive."""
        self._dt = dt
        self._hubs = [wheel.getChildBodyNode() for wheel in self.wheels]
        self._drive: Drive = "torque"
        world.simulation.addSkeleton(skeleton)
        world.check_detector(skeleton)

    @abstractmethod
    def prepare(self, speeds: Sequence[tuple[float, float]], steps: int, *, isolated: bool) -> int:
        """Return how many of `steps` steps can be simulated before the next call.

        Args:
            speeds: The lowest and the highest that each wheel should have in them [rad/s].
            steps: At least 1.
            isolated: Whether the robot is upright and nothing but the ground can touch it.
        """

    @abstractmethod
    def settle(self, steps: int) -> None:
        """Take over from DART after `steps` steps that were simulated."""

    @abstractmethod
    def read(self) -> Motion:
        """Return the present motion, of all rollers."""

    @abstractmethod
    def write(self, motion: Motion) -> None:
        """Put the robot into `motion`."""

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
            return [wheel.getConstraintImpulse(0) / self._dt for wheel in self.wheels]
        return [wheel.getCommand(0) for wheel in self.wheels]


class AllRollersBody(RobotBody):
    """A robot of which every roller is a body."""

    def __init__(
        self, robot: Robot, start: Pose2D, physics: PhysicsConfig, world: WorldConfig
    ) -> None:
        skeleton, joints = bodies.build_robot(full_tree(robot), robot, start, physics, world)
        super().__init__(DartWorld(robot, physics, world), skeleton, joints, physics.dt_s)
        rollers = [joint.getChildBodyNode() for joint in joints[len(WHEELS) :]]
        self._candidates = ContactCandidates(robot, rollers)
        self.joint_names = tuple(joint.getName() for joint in joints)
        """In the order of `Motion`."""

    def move_to(self, world: DartWorld) -> None:
        """Go on in another world of DART, in the same motion."""
        if world is not self.world:
            self.world.simulation.removeSkeleton(self.skeleton)
            world.simulation.addSkeleton(self.skeleton)
            self.world = world

    def prepare(self, speeds: Sequence[tuple[float, float]], steps: int, *, isolated: bool) -> int:
        """Choose the contact candidates; see `RobotBody`."""
        angles = [wheel.getPosition(0) for wheel in self.wheels]
        fastest = [max(-low, high) for low, high in speeds]
        self._candidates.update(angles, fastest, steps * self._dt, isolated=isolated)
        return steps

    def settle(self, steps: int) -> None:
        """Do nothing: all of the motion is DART's."""

    def read(self) -> Motion:
        """See `RobotBody`."""
        return Motion(self.skeleton.getPositions().tolist(), self.skeleton.getVelocities().tolist())

    def write(self, motion: Motion) -> None:
        """See `RobotBody`."""
        self.skeleton.setPositions(motion.position)
        self.skeleton.setVelocities(motion.velocity)
