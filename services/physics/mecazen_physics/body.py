"""The robot's body in DART: base, front axle, wheels, and every roller on its joint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import dartpy as dart
from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.geometry import Pose2D
from mecazen.robot import WHEELS, Robot

from mecazen_physics import bodies
from mecazen_physics.scene import Layers, Scene
from mecazen_physics.state import BASE_DOFS, ROOT_DOFS, Motion, quaternion

Drive = Literal["servo", "torque"]
"""Quantity that the motors control: a speed within their torque limit, or a torque."""
_ACTUATORS = {"servo": dart.dynamics.SERVO, "torque": dart.dynamics.FORCE}
MAX_TILT_RAD = 0.05
"""Maximum tilt of a robot whose wheels stand on the ground [rad]."""
LIFT_M_S = 0.02
"""A wheel that rises faster is leaving the ground [m/s]."""
DEEPEST_M = 1e-3
"""Maximum depth of a wheel that stands by its own weight [m]."""
ALIGNED_RAD = math.radians(2.0)
"""Maximum angle between the axes of DART and rollers: friction is then 1/cos 2° = 1.0006 of its
value."""


class RobotBody:
    """A robot in a scene."""

    def __init__(
        self,
        scene: Scene,
        robot: Robot,
        start: Pose2D,
        physics: PhysicsConfig,
        world: WorldConfig,
    ) -> None:
        self.scene = scene
        self._robot = robot
        self._half_wheelbase, self._half_track = robot.half_wheelbase, robot.half_track
        self._dt = physics.dt_s
        self.skeleton, joints = bodies.build_robot(robot, start, world)
        self.wheels = joints[: len(WHEELS)]
        """The joints that motors drive."""
        children = [joint.getChildBodyNode() for joint in joints]
        self._hubs, self.rollers = children[: len(WHEELS)], children[len(WHEELS) :]
        base = self.skeleton.getBodyNode(0)
        self._layers: Layers = {"base": [base], "wheel": self._hubs, "roller": self.rollers}
        self.drive: Drive = "torque"
        """Quantity that the motors control now."""
        self.is_projected = False
        """Whether the last call of `stand` has put all wheels on the ground plane."""
        scene.add(self.skeleton, self._layers)

    def read(self) -> Motion:
        """Return the present motion."""
        position, velocity = self.skeleton.getPositions(), self.skeleton.getVelocities()
        return Motion(position.tolist(), velocity.tolist(), self.scene.heading)

    def write(self, motion: Motion) -> None:
        """Set the robot's motion; the scene's axes do not change."""
        motion = motion.in_axes_at(self.scene.heading)
        self.skeleton.setPositions(motion.position)
        self.skeleton.setVelocities(motion.velocity)

    def align(self, yaw: float, yaw_rate: float, *, alone: bool) -> None:
        """Turn the scene's axes to the rollers' if the robot is alone, else to the world's."""
        off, heading = self.scene.alignment(yaw), 0.0
        if alone and off is not None:
            if abs(off) <= ALIGNED_RAD:
                return
            ahead = math.copysign(0.5 * ALIGNED_RAD, yaw_rate) if yaw_rate else 0.0
            heading = math.remainder(yaw - math.pi / 4.0 + ahead, math.tau)
        if heading != self.scene.heading:
            motion = self.read().in_axes_at(heading)
            self.scene.turn(heading)
            root = self.skeleton.getRootJoint()
            root.setPositions(motion.position[:ROOT_DOFS])
            root.setVelocities(motion.velocity[:ROOT_DOFS])

    def stand(self) -> None:
        """Project the positions so that all wheels stand on the ground plane.

        Wheels are round, so four wheels on a plane determine the height, two tilts, and the front
        axle's angle. DART keeps the wheels on the ground by velocities only. A wheel whose roller
        leaves the ground within a step falls freely for that step, g·dt² deep, and the next roller
        pushes it out; it loses grip and energy each time. Therefore positions are projected after
        each step (E. Eich, "Convergence results for a coordinate projection method", 1993);
        DART's velocities do not change. If a wheel rises faster than `LIFT_M_S`, or is deeper than
        `DEEPEST_M`, nothing is done.
        """
        self.is_projected = False
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
            self.is_projected = True

    def lift(self) -> None:
        """Lift the robot out of the ground if a foot has pressed it in.

        The origin of base_link is the mean of the wheels' lowest points, so no attitude of a robot
        above the ground brings it below.
        """
        position = self.skeleton.getPositions()
        if -self._robot.rollers.max_radius_m < position[5] < -DEEPEST_M:
            position[5] = 0.0
            self.skeleton.setPositions(position)

    def add_rims(self) -> None:
        """Add the rims of the wheels, which obstacles, people and other robots touch.

        A robot that never meets another has no rims: they would take time, and change the order in
        which DART finds contacts.
        """
        if not self._hubs[0].getShapeNodes():
            bodies.add_rims(self._hubs, self._robot)
            self.scene.renew_detector()

    def set_friction(self, coefficients: Sequence[float]) -> None:
        """Set the coefficient between the rollers of each wheel and the ground."""
        count = len(self.rollers) // len(WHEELS)
        for wheel, friction in enumerate(coefficients):
            for roller in self.rollers[wheel * count : (wheel + 1) * count]:
                roller.getShapeNode(0).getDynamicsAspect().setFrictionCoeff(friction)

    def leave(self) -> Motion:
        """Leave the scene; return the motion."""
        motion = self.read()
        self.scene.remove(self.skeleton)
        return motion

    def enter(self, scene: Scene, motion: Motion) -> None:
        """Enter a scene with a motion."""
        scene.add(self.skeleton, self._layers)
        self.scene = scene
        self.write(motion)

    def use(self, drive: Drive) -> None:
        """Take the wheels' commands as speeds [rad/s] or as torques [N·m]."""
        if drive != self.drive:
            self.drive = drive
            for wheel in self.wheels:
                wheel.setActuatorType(_ACTUATORS[drive])

    def torques(self) -> list[float]:
        """Return the torques of the wheels' motors in the last step [N·m]."""
        if self.drive == "servo":
            # DART's servo is a velocity constraint; its torque is that constraint's impulse.
            return [wheel.getConstraintImpulse(0) / self._dt for wheel in self.wheels]
        return [wheel.getCommand(0) for wheel in self.wheels]
