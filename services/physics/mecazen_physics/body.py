"""The robot's body in DART: what its models have in common, and the one of all rollers."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Literal

import dartpy as dart
from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS, Robot

from mecazen_physics import bodies
from mecazen_physics.contacts import ContactCandidates
from mecazen_physics.dart_world import DartWorld, RobotBodies
from mecazen_physics.model import full_tree
from mecazen_physics.ridges import RidgeContacts
from mecazen_physics.state import BASE_DOFS, ROOT_DOFS, Motion, quaternion

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


LIFT_M_S = 0.02
"""A wheel that rises faster leaves the ground."""
DEEPEST_M = 1e-3
"""A wheel that is deeper was not set onto the ground by its own weight."""

ALIGNED_RAD = math.radians(2.0)
"""So far DART's axes may be from those of the rollers: friction is 1/cos 2° = 1.0006 of its own."""


class RobotBody(ABC):
    """A robot in a world of DART, as one of the two models of its rollers.

    Args:
        world: Where the robot is at first.
        skeleton: The robot's.
        joints: Of its wheels and of those of its rollers that are bodies.
        robot: Its dimensions.
        dt: The length of a step [s].

    Raises:
        UnsupportedError: if dartpy does not simulate the rollers' shape.
    """

    def __init__(
        self, world: DartWorld, skeleton: Any, joints: Sequence[Any], robot: Robot, dt: float
    ) -> None:
        self.world, self.skeleton = world, skeleton
        self._half_wheelbase, self._half_track = robot.half_wheelbase, robot.half_track
        self.wheels = joints[: len(WHEELS)]
        """The joints that motors drive."""
        self._dt = dt
        children = [joint.getChildBodyNode() for joint in joints]
        self._hubs, rollers = children[: len(WHEELS)], children[len(WHEELS) :]
        self._bodies = RobotBodies(skeleton, self._hubs, rollers)
        self._torques = [0.0] * len(WHEELS)
        """Of the motors in the last step, where they hold speeds [N·m]."""
        self.drive: Drive = "torque"
        """What the wheels' motors hold now."""
        world.add(self._bodies)
        world.check_detector(skeleton)

    @abstractmethod
    def prepare(self, speeds: Sequence[tuple[float, float]], steps: int, *, upright: bool) -> int:
        """Return how many of `steps` steps can be simulated before the next call.

        Args:
            speeds: The lowest and the highest that each wheel should have in them [rad/s].
            steps: At least 1.
            upright: Whether no roller far from the bottom can touch the ground.
        """

    @abstractmethod
    def settle(self, steps: int) -> None:
        """Take over from DART after `steps` steps that were simulated."""

    def align(self, yaw: float, yaw_rate: float) -> None:
        """Turn DART's axes with the robot, where they can be, once its rollers are out of them.

        Args:
            yaw: Of the robot in the world [rad].
            yaw_rate: Its rate [rad/s]: the axes are turned ahead.
        """
        aim = yaw - math.pi / 4.0
        off = math.remainder(aim - self.world.heading, math.pi / 2.0)
        if self.world.aligned and abs(off) > ALIGNED_RAD:
            ahead = math.copysign(0.5 * ALIGNED_RAD, yaw_rate) if yaw_rate else 0.0
            motion = self.read()
            self.world.turn(math.remainder(aim + ahead, math.tau))
            self._turn(motion.in_axes_at(self.world.heading))

    def _turn(self, motion: Motion) -> None:
        """Take over a motion that differs from the present one by its axes alone."""
        root = self.skeleton.getRootJoint()
        root.setPositions(motion.position[:ROOT_DOFS])
        root.setVelocities(motion.velocity[:ROOT_DOFS])

    def after_step(self, limit: float, *, stands: bool) -> bool:
        """Check the motors after a step, and project the robot onto the plane of the ground.

        Args:
            limit: Of a motor's torque [N·m].
            stands: Whether its wheels stand on that plane.

        Returns:
            Whether no motor that holds a speed exceeded its torque.
        """
        if limit < math.inf:
            self._torques = [float(hub.getBodyForce()[1]) for hub in self._hubs]
            if max(self._torques) > limit or min(self._torques) < -limit:
                return False
        if stands:
            self._stand()
        return True

    def _stand(self) -> None:
        """Project positions onto the plane that the wheels stand on.

        Wheels are round, so on a plane the four of them leave nothing open: height, two tilts, and
        the front axle's angle. DART keeps them up by velocities alone. A wheel whose roller leaves
        the ground within a step falls freely for as long, g·dt² deep, is pushed out by the next
        roller, and loses grip and energy each time. Hence this projection after each step
        (E. Eich, "Convergence results for a coordinate projection method", 1993); velocities
        stay. Where a wheel rises faster than `LIFT_M_S`, or is deeper than `DEEPEST_M`,
        nothing is done.
        """
        position = self.skeleton.getPositions()
        rx, ry, rz, _, _, z, axle = position[:BASE_DOFS].tolist()
        qx, qy, qz, qw = quaternion(rx, ry, rz)
        ahead = 2.0 * self._half_wheelbase * (qx * qz - qw * qy)
        aside = 2.0 * self._half_track * (qy * qz + qw * qx)
        rear, front = abs(aside), abs(aside + self._half_track * axle)
        if max(z + ahead + front, z - ahead + rear) > LIFT_M_S * self._dt:
            return
        if min(z + ahead - front, z - ahead - rear) > -DEEPEST_M:
            position[0] = position[1] = position[5] = position[6] = 0.0
            self.skeleton.setPositions(position)

    @abstractmethod
    def take_back(self) -> None:
        """Go back to where the last call of `prepare` left it."""

    @abstractmethod
    def read(self) -> Motion:
        """Return the present motion, of all rollers."""

    @abstractmethod
    def write(self, motion: Motion) -> None:
        """Put the robot into `motion`; a world's own axes stay as they are."""

    def add_rims(self, robot: Robot, world: WorldConfig) -> None:
        """Have what other robots touch: the base, and rims of the wheels.

        A robot that never meets another has none: they would take time, and change the order in
        which DART finds contacts.
        """
        if not self._hubs[0].getShapeNodes():
            bodies.add_rims(self.skeleton, self._hubs, robot, world)

    def set_friction(self, coefficients: Sequence[float]) -> None:
        """Set the coefficient between the rollers of each wheel and the ground."""
        rollers, count = self._bodies.rollers, len(self._bodies.rollers) // len(WHEELS)
        for wheel, friction in enumerate(coefficients):
            for roller in rollers[wheel * count : (wheel + 1) * count]:
                roller.getShapeNode(0).getDynamicsAspect().setFrictionCoeff(friction)

    def move_to(self, world: DartWorld) -> None:
        """Go on in another world of DART, in the same motion."""
        if world is not self.world:
            motion = self.leave()
            self.enter(world, motion)

    def leave(self) -> Motion:
        """Leave the world of DART; return the motion."""
        motion = self.read()
        self.world.remove(self._bodies)
        return motion

    def enter(self, world: DartWorld, motion: Motion) -> None:
        """Go on in a world of DART."""
        world.add(self._bodies)
        self.world = world
        self.write(motion)

    def use(self, drive: Drive) -> None:
        """Take the wheels' commands as speeds [rad/s] or as torques [N·m]."""
        if drive != self.drive:
            self.drive = drive
            for wheel in self.wheels:
                wheel.setActuatorType(_ACTUATORS[drive])

    def torques(self) -> list[float]:
        """Return what the wheels' motors gave in the last step [N·m]."""
        if self.drive == "speed":
            return self._torques
        if self.drive == "servo":
            # DART's servo is a velocity constraint; its torque is that constraint's impulse.
            return [wheel.getConstraintImpulse(0) / self._dt for wheel in self.wheels]
        return [wheel.getCommand(0) for wheel in self.wheels]


class AllRollersBody(RobotBody):
    """A robot of which every roller is a body."""

    def __init__(
        self,
        robot: Robot,
        start: Pose2D,
        physics: PhysicsConfig,
        world: WorldConfig,
        dart_world: DartWorld,
    ) -> None:
        skeleton, joints = bodies.build_robot(full_tree(robot), robot, start, world)
        super().__init__(dart_world, skeleton, joints, robot, physics.dt_s)
        self._candidates = ContactCandidates(robot, self._bodies.rollers)
        self.joint_names = tuple(joint.getName() for joint in joints)
        """In the order of `Motion`."""
        ground = bodies.ground_friction(robot, world)
        self.ridges = RidgeContacts(robot, world.ridges, self._hubs, self._bodies.rollers, ground)
        """What carries it over ramps and sills."""

    def prepare(self, speeds: Sequence[tuple[float, float]], steps: int, *, upright: bool) -> int:
        """Choose the contact candidates; see `RobotBody`."""
        angles = [wheel.getPosition(0) for wheel in self.wheels]
        fastest = [max(-low, high) for low, high in speeds]
        self._candidates.update(angles, fastest, steps * self._dt, upright=upright)
        self._prepared = self.read()
        return steps

    def take_back(self) -> None:
        """See `RobotBody`."""
        self.write(self._prepared)

    def settle(self, steps: int) -> None:
        """Do nothing: all of the motion is DART's."""

    def read(self) -> Motion:
        """See `RobotBody`."""
        position, velocity = self.skeleton.getPositions(), self.skeleton.getVelocities()
        return Motion(position.tolist(), velocity.tolist(), self.world.heading)

    def write(self, motion: Motion) -> None:
        """See `RobotBody`."""
        motion = motion.in_axes_at(self.world.heading)
        self.skeleton.setPositions(motion.position)
        self.skeleton.setVelocities(motion.velocity)
