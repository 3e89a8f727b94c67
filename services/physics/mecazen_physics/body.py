"""The robot's body in DART: base, front axle, wheels, and every roller on its joint."""

from __future__ import annotations

import math
from typing import Any

import dartpy as dart
import numpy as np
from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.geometry import Pose2D
from mecazen.links import base_link, lump, robot_links
from mecazen.robot import WHEELS, Robot
from mecazen.rollers import Roller

from mecazen_physics.state import BASE_DOFS, in_axes_at, quaternion
from mecazen_physics.world import (
    PERSON_FRICTION,
    SOLID_FRICTION,
    DartWorld,
    Layers,
    UnsupportedError,
    add_shape,
    ground_frictions,
    upright,
)

MAX_TILT_RAD = 0.05
"""Maximum tilt of a robot whose wheels stand on the ground [rad]."""
LIFT_M_S = 0.02
"""A wheel that rises faster is leaving the ground [m/s]."""
DEEPEST_M = 1e-3
"""Maximum depth of a wheel that stands by its own weight [m]."""
ALIGNED_RAD = math.radians(2.0)
"""Maximum angle between the axes of DART and rollers: friction is then 1/cos 2° = 1.0006 of its
value."""
AXLE_STOP_RAD = 0.1
"""Angle at which the front axle meets its stops [rad]."""
_NO_MASS = 1e-9


class RobotBody:
    """A robot in a DART world, at rest at `start`.

    Raises:
        UnsupportedError: A roller's bearing has too much friction for the step.
    """

    def __init__(
        self,
        dart_world: DartWorld,
        robot: Robot,
        start: Pose2D,
        physics: PhysicsConfig,
        world: WorldConfig,
    ) -> None:
        _check_bearings(robot, physics)
        self.world = dart_world
        self._robot, self._dt = robot, physics.dt_s
        self._half_wheelbase, self._half_track = robot.half_wheelbase, robot.half_track
        self._centre = robot.wheels.centre_m
        self.max_depth = robot.rollers.max_radius_m
        """A robot whose base_link is deeper in the ground [m] has diverged.

        The origin of base_link is between the wheels' lowest points, so no attitude of a robot
        above the ground brings it below.
        """
        self.skeleton, joints = _build(robot, start, world)
        self._root, self._axle = self.skeleton.getJoint(0), self.skeleton.getJoint(1)
        self.wheels = joints[: len(WHEELS)]
        """The joints that motors drive."""
        children = [joint.getChildBodyNode() for joint in joints]
        self.hubs, self.rollers = children[: len(WHEELS)], children[len(WHEELS) :]
        """The bodies of the wheels without their rollers, and those of the rollers by wheel."""
        count = robot.rollers.count
        self._pitch = math.tau / count
        """Angle from one roller of a wheel to the next [rad]."""
        shapes = [roller.getShapeNode(0) for roller in self.rollers]
        self._shapes = [shapes[i * count : (i + 1) * count] for i in range(len(WHEELS))]
        """The shapes of the rollers of each wheel."""
        self._friction: list[float] = []
        base = self.skeleton.getBodyNode(0)
        self._base_shapes = base.getShapeNodes()
        self._lowest: list[int] = []
        """The lowest roller of each wheel, or nothing while all shapes collide."""
        self._position: list[float] = []
        """Positions at the last call of `stand`."""
        self._layers: Layers = {"base": [base], "wheel": self.hubs, "roller": self.rollers}
        self.is_projected = False
        """Whether the last call of `stand` has put all wheels on the ground plane."""
        dart_world.add(self.skeleton, self._layers)

    def align(self, yaw: float, yaw_rate: float, *, alone: bool) -> None:
        """Turn DART's axes to the rollers' if the robot is alone, else to the world's."""
        off, heading = self.world.alignment(yaw), 0.0
        if alone and off is not None:
            if abs(off) <= ALIGNED_RAD:
                return
            ahead = math.copysign(0.5 * ALIGNED_RAD, yaw_rate) if yaw_rate else 0.0
            heading = math.remainder(yaw - math.pi / 4.0 + ahead, math.tau)
        if heading != self.world.heading:
            self._turn(self.world.heading - heading)
            self.world.turn(heading)

    def _turn(self, angle: float) -> None:
        """Write the same motion in axes that are turned by -`angle`."""
        position, velocity = self._root.getPositions().tolist(), self._root.getVelocities().tolist()
        position, velocity = in_axes_at(position, velocity, angle)
        self._root.setPositions(position)
        self._root.setVelocities(velocity)

    def move_to(self, world: DartWorld) -> None:
        """Leave the present world, and enter another one with the same motion."""
        self.expose_all()
        self.world.remove(self.skeleton)
        self._turn(self.world.heading - world.heading)
        world.add(self.skeleton, self._layers)
        self.world = world

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
        self._position = self.skeleton.getPositions().tolist()
        rx, ry, rz, x, y, z, axle = self._position[:BASE_DOFS]
        qx, qy, qz, qw = quaternion(rx, ry, rz)
        pitch, roll = 2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx)
        z += pitch * self._centre[0] + roll * self._centre[1]
        ahead, aside = pitch * self._half_wheelbase, roll * self._half_track
        rear, front = abs(aside), abs(aside + self._half_track * axle)
        if max(z + ahead + front, z - ahead + rear) > LIFT_M_S * self._dt:
            return
        if min(z + ahead - front, z - ahead - rear) > -DEEPEST_M:
            self._root.setPositions((0.0, 0.0, rz, x, y, 0.0))
            self._axle.setPosition(0, 0.0)
            self.is_projected = True

    def lift(self) -> None:
        """Lift the robot out of the ground if a foot has pressed it in."""
        position = self._root.getPositions()
        if -self.max_depth <= position[5] < -DEEPEST_M:
            position[5] = 0.0
            self._root.setPositions(position)

    def expose_lowest(self) -> None:
        """Let only the lowest roller of each wheel and its two neighbours collide, not the base.

        Call it after each step: within a step, a wheel at its highest speed passes no roller. The
        search for the contacts of all shapes takes 8 to 10 % of the time of `Simulation.advance`.
        """
        count = self._robot.rollers.count
        angles = self._position[BASE_DOFS : BASE_DOFS + len(WHEELS)]
        if not math.isfinite(sum(angles)):
            return  # diverged, which `check_converged` reports
        lowest = [-round(angle / self._pitch) % count for angle in angles]
        if lowest != self._lowest:
            self._lowest = lowest
            near = [
                shapes[number + offset]
                for shapes, number in zip(self._shapes, lowest, strict=True)
                for offset in (-1, 0, 1 - count)
            ]
            # First all that is hidden: what Bullet removes makes room for what it added last.
            self.world.hide(self._base_shapes)
            for shapes in self._shapes:
                self.world.hide(shape for shape in shapes if shape not in near)
            self.world.show(near)

    def expose_all(self) -> None:
        """Let the base and all rollers collide."""
        if self._lowest:
            self._lowest = []
            self.world.show_all()

    def add_rims(self) -> None:
        """Add the rims of the wheels, which obstacles, people and other robots touch.

        A rim is the cylinder round all rollers of a wheel. A rim has no friction: a roller gives
        way across its axis, so two touching rollers transmit a force along the surface only if
        their axes are parallel. A robot that never meets another has no rims: they would take time,
        and change the order in which DART finds contacts.
        """
        if self.hubs[0].getShapeNodes():
            return
        robot = self._robot
        centres, radii = Roller.from_robot(robot).spheres(robot.rollers.hull_spheres)
        rollers = 2.0 * float(np.max(centres * math.cos(robot.roller_angle) + radii))
        width = max(robot.wheels.hub_width_m, rollers)
        for hub in self.hubs:
            rim = add_shape(hub, dart.dynamics.CylinderShape(robot.wheels.radius_m, width), 0.0)
            rim.setRelativeRotation([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        self.world.renew_detector()

    def set_friction(self, coefficients: list[float]) -> None:
        """Set the coefficient between the rollers of each wheel and the ground."""
        if coefficients == self._friction:
            return
        self._friction = coefficients
        for friction, shapes in zip(coefficients, self._shapes, strict=True):
            for shape in shapes:
                shape.getDynamicsAspect().setFrictionCoeff(friction)


def _check_bearings(robot: Robot, physics: PhysicsConfig) -> None:
    """Refuse a friction c that slows a roller down within a few steps.

    DART damps a joint before it solves the contacts. So a roller that the ground keeps turning has
    the friction c/(1 + c·dt/I) instead of c.
    """
    highest = 0.1 * Roller.from_robot(robot).inertia[1] / physics.dt_s
    friction = robot.rollers.bearing_friction_nms
    if friction > highest:
        raise UnsupportedError(
            f"rollers.bearing_friction_nms = {friction} must be below {highest:.3g}, "
            f"or physics.dt_s = {physics.dt_s} smaller, to be simulated within 10 %"
        )


def _build(robot: Robot, start: Pose2D, world: WorldConfig) -> tuple[Any, list[Any]]:
    """Return the skeleton of the robot and the joints of its wheels and rollers.

    Camera, lidar and payload are shapes and mass of the base: a separate body for each would cost 5
    % of the speed.

    The front wheels are on an axle that swings about its middle, as in platforms of this
    kind. If the robot were rigid, two diagonally opposite wheels would carry the whole weight.
    The rollers of these two wheels are parallel, so the robot would glide across them with all
    wheels at rest.
    """
    links = robot_links(robot)
    skeleton = dart.dynamics.Skeleton("robot")
    root, base = skeleton.createFreeJointAndBodyNodePair()
    base.setName("base_link")
    root.setTransform(upright(start, 0.0))
    trunk = [base_link(robot), *(link for link in links if link.axis is None)]
    base.setInertia(dart.dynamics.Inertia(*lump(trunk)))
    # DART uses the lower coefficient of two touching bodies. The robot's own surface gets the
    # highest, so the coefficient of the other body applies. Between two robots the highest applies.
    friction = max(*ground_frictions(robot, world), PERSON_FRICTION, SOLID_FRICTION)
    _add_base_shapes(base, robot, friction)
    x, y = robot.wheels.centre_m
    hinge = (x + robot.half_wheelbase, y, robot.wheels.radius_m)
    axle = _add_axle(base, hinge)
    bodies, joints = {"base_link": base}, []
    for link in links:
        if link.axis is None:
            continue
        parent, place = bodies[link.parent], np.array(link.translation)
        if parent is base and link.translation[0] > x:
            parent, place = axle, place - hinge
        joint, body = skeleton.createRevoluteJointAndBodyNodePair(parent)
        joint.setName(link.joint)
        body.setName(link.name)
        joint.setAxis(link.axis)
        joint.setTransformFromParentBodyNode(dart.math.Isometry3(link.rotation, place))
        body.setInertia(dart.dynamics.Inertia(link.mass, link.centre, np.diag(link.moments)))
        bodies[link.name] = body
        joints.append(joint)
    limit = robot.wheels.max_torque_nm
    for wheel in joints[: len(WHEELS)]:
        wheel.setForceUpperLimit(0, limit)
        wheel.setForceLowerLimit(0, -limit)
    centres, radii = Roller.from_robot(robot).spheres(robot.rollers.hull_spheres)
    spheres = zip(radii, centres, strict=True)
    barrel = dart.dynamics.MultiSphereConvexHullShape([(r, [0.0, 0.0, z]) for r, z in spheres])
    for roller in joints[len(WHEELS) :]:
        roller.setDampingCoefficient(0, robot.rollers.bearing_friction_nms)
        add_shape(roller.getChildBodyNode(), barrel, friction)
    return skeleton, joints


def _add_axle(base: Any, hinge: tuple[float, float, float]) -> Any:
    joint, axle = base.createRevoluteJointAndBodyNodePair()
    joint.setName("front_axle_joint")
    axle.setName("front_axle")
    joint.setAxis([1.0, 0.0, 0.0])
    joint.setTransformFromParentBodyNode(dart.math.Isometry3(np.eye(3), hinge))
    joint.setPositionLowerLimit(0, -AXLE_STOP_RAD)
    joint.setPositionUpperLimit(0, AXLE_STOP_RAD)
    joint.setLimitEnforcement(True)
    # The axle's mass is included in the base.
    axle.setInertia(dart.dynamics.Inertia(_NO_MASS, np.zeros(3), _NO_MASS * np.eye(3)))
    return axle


def _add_base_shapes(base: Any, robot: Robot, friction: float) -> None:
    size = [robot.base.length_m, robot.base.width_m, robot.base.height_m]
    add_shape(base, dart.dynamics.BoxShape(size), friction, base_link(robot).centre)
    if (camera := robot.camera) is not None:
        add_shape(base, dart.dynamics.BoxShape(camera.size_m), friction, camera.position_m)
    if (lidar := robot.lidar) is not None:
        add_shape(base, dart.dynamics.CylinderShape(*lidar.size_m), friction, lidar.position_m)
    if (load := robot.payload) is not None:
        add_shape(base, dart.dynamics.BoxShape(load.size_m), friction, load.position_m)
