"""DART skeletons of the ground, obstacles, robots and people."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import dartpy as dart
import numpy as np
from mecazen.config import PhysicsConfig, WorldConfig
from mecazen.config.world import Box, Cylinder, Patch, PersonConfig
from mecazen.geometry import Pose2D
from mecazen.links import base_link, lump, robot_links
from mecazen.robot import WHEELS, Robot
from mecazen.rollers import Roller

from mecazen_physics.errors import UnsupportedError
from mecazen_physics.people import LEGS

GRAVITY = 9.80665
"""Standard gravity [m/s²]."""

SOLID_FRICTION, PERSON_FRICTION = 1.0, 0.5
"""Coulomb coefficients between the robot and obstacles or persons."""

DEPTH_M = 1e-5
"""Depth of the wheels in DART's ground [m]; the ground is raised above z = 0 by the same depth.

Hulls of 81 spheres are up to 0.4 µm out of round. At this depth every wheel that stands has a
contact."""

_AXLE_JOINT = "front_axle_joint"
_AXLE_STOP_RAD = 0.1
_NO_MASS = 1e-9


def check_bearings(robot: Robot, physics: PhysicsConfig) -> None:
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


def highest_friction(robot: Robot, world: WorldConfig) -> float:
    """Return the highest friction coefficient of a robot and its surroundings.

    DART uses the lower coefficient of two touching bodies. The robot's own surface gets the
    highest, so the coefficient of the other body applies. Between two robots the highest applies.
    """
    solids = [SOLID_FRICTION] * bool(world.solids)
    return max(*ground_frictions(robot, world), PERSON_FRICTION, *solids)


def ground_frictions(robot: Robot, world: WorldConfig) -> list[float]:
    """Return the friction coefficients between the rollers and the ground with its patches."""
    patches = [ground_friction(robot, patch) for patch in world.patches]
    return [ground_friction(robot, world), *patches]


def ground_friction(robot: Robot, ground: WorldConfig | Patch) -> float:
    """Return the friction coefficient between the rollers and the ground, or a patch of it."""
    own = ground.friction if isinstance(ground, Patch) else ground.ground_friction
    return own * robot.rollers.contact_friction


def build_ground(robot: Robot, world: WorldConfig) -> Any:
    """Return the skeleton of the ground, a plane."""
    skeleton = dart.dynamics.Skeleton("ground")
    _, ground = skeleton.createWeldJointAndBodyNodePair()
    plane = dart.dynamics.PlaneShape([0.0, 0.0, 1.0], DEPTH_M)
    # On patches, `set_friction` sets the coefficient of the rollers.
    _collide(ground, plane, max(ground_frictions(robot, world)))
    skeleton.setMobile(False)
    return skeleton


def build_obstacles(solids: Sequence[Box | Cylinder]) -> Any:
    """Return the skeleton of all obstacles, a body with a shape for each.

    A body for each would take time that grows with the square of their number.
    """
    skeleton = dart.dynamics.Skeleton("obstacles")
    _, body = skeleton.createWeldJointAndBodyNodePair()
    for solid in solids:
        height, bottom = solid.size_m[-1], getattr(solid, "bottom_m", 0.0)
        if isinstance(solid, Box):
            shape = dart.dynamics.BoxShape(list(solid.size_m))
            yaw = math.radians(solid.yaw_deg)
        else:
            shape = dart.dynamics.CylinderShape(*solid.size_m)
            yaw = 0.0
        pose = _planar(Pose2D(*solid.position_m, yaw), bottom + height / 2)
        _collide(body, shape, SOLID_FRICTION).setRelativeTransform(pose)
    skeleton.setMobile(False)
    return skeleton


def reachable(robot: Robot, world: WorldConfig) -> list[Box | Cylinder]:
    """Return the obstacles of the world, without those that the robot passes below."""
    found = [one for one in world.solids if getattr(one, "bottom_m", 0.0) < robot.height]
    for solid in found:
        height = solid.size_m[-1]
        if getattr(solid, "bottom_m", 0.0) == 0.0 and height < robot.wheels.radius_m:
            # On a face of a box the rollers' contacts jump; only contacts with a plane are smooth.
            raise UnsupportedError(
                f"an obstacle {height} m high is lower than the wheels' axles "
                f"({robot.wheels.radius_m} m): driving onto one cannot be simulated"
            )
    return found


def build_planes(count: int, friction: float) -> tuple[Any, list[Any]]:
    """Return a skeleton of planes, and their bodies."""
    skeleton = dart.dynamics.Skeleton("planes")
    planes = [skeleton.createWeldJointAndBodyNodePair()[1] for _ in range(count)]
    for plane in planes:
        _collide(plane, dart.dynamics.PlaneShape([0.0, 0.0, 1.0], 0.0), friction)
    skeleton.setMobile(False)
    return skeleton, planes


def build_robot(robot: Robot, start: Pose2D, world: WorldConfig) -> tuple[Any, list[Any]]:
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
    root.setTransform(_planar(start, 0.0))
    trunk = [base_link(robot), *(link for link in links if link.axis is None)]
    base.setInertia(dart.dynamics.Inertia(*lump(trunk)))
    friction = highest_friction(robot, world)
    _collide_base(base, robot, friction)
    barrel = _barrel(robot)
    hinge = (robot.half_wheelbase, 0.0, robot.wheels.radius_m)
    axle = _add_axle(base, hinge)
    bodies, joints = {"base_link": base}, []
    for link in links:
        if link.axis is None:
            continue
        parent, place = bodies[link.parent], np.array(link.translation)
        if parent is base and link.translation[0] > 0.0:
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
    for roller in joints[len(WHEELS) :]:
        roller.setDampingCoefficient(0, robot.rollers.bearing_friction_nms)
        _collide(roller.getChildBodyNode(), barrel, friction)
    return skeleton, joints


def _add_axle(base: Any, hinge: tuple[float, float, float]) -> Any:
    joint, axle = base.createRevoluteJointAndBodyNodePair()
    joint.setName(_AXLE_JOINT)
    axle.setName("front_axle")
    joint.setAxis([1.0, 0.0, 0.0])
    joint.setTransformFromParentBodyNode(dart.math.Isometry3(np.eye(3), hinge))
    joint.setPositionLowerLimit(0, -_AXLE_STOP_RAD)
    joint.setPositionUpperLimit(0, _AXLE_STOP_RAD)
    joint.setLimitEnforcement(True)
    # The axle's mass is included in the base.
    axle.setInertia(dart.dynamics.Inertia(_NO_MASS, np.zeros(3), _NO_MASS * np.eye(3)))
    return axle


def _collide_base(base: Any, robot: Robot, friction: float) -> None:
    box = dart.dynamics.BoxShape([robot.base.length_m, robot.base.width_m, robot.base.height_m])
    _collide(base, box, friction, base_link(robot).centre)
    camera = dart.dynamics.BoxShape(robot.camera.size_m)
    _collide(base, camera, friction, robot.camera.position_m)
    lidar = dart.dynamics.CylinderShape(*robot.lidar.size_m)
    _collide(base, lidar, friction, robot.lidar.position_m)
    if robot.payload is not None:
        load = dart.dynamics.BoxShape(robot.payload.size_m)
        _collide(base, load, friction, robot.payload.position_m)


def _barrel(robot: Robot) -> Any:
    centres, radii = Roller.from_robot(robot).spheres(robot.rollers.hull_spheres)
    return dart.dynamics.MultiSphereConvexHullShape(
        [(radius, [0.0, 0.0, centre]) for centre, radius in zip(centres, radii, strict=True)]
    )


def add_rims(wheels: Sequence[Any], robot: Robot) -> None:
    """Add the rims of the wheels, which others touch.

    A rim is the cylinder round all rollers of a wheel. A rim has no friction: a roller gives way
    across its axis, so two touching rollers transmit a force along the surface only if their axes
    are parallel.
    """
    centres, radii = Roller.from_robot(robot).spheres(robot.rollers.hull_spheres)
    rollers = 2.0 * float(np.max(centres * math.cos(robot.roller_angle) + radii))
    width = max(robot.wheels.hub_width_m, rollers)
    for wheel in wheels:
        cylinder = dart.dynamics.CylinderShape(robot.wheels.radius_m, width)
        node = _collide(wheel, cylinder, 0.0)
        node.setRelativeRotation([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def build_person(shape: PersonConfig) -> Any:
    """Return a person's skeleton, whose two positions are x and y [m].

    The joint moves at the commanded velocity, independent of contacts.
    """
    skeleton = dart.dynamics.Skeleton("person")
    joint, body = skeleton.createTranslationalJoint2DAndBodyNodePair()
    joint.setTransformFromParentBodyNode(_planar(Pose2D(), shape.height_m / 2))
    joint.setActuatorType(dart.dynamics.VELOCITY)
    cylinder = dart.dynamics.CylinderShape(shape.radius_m, shape.height_m)
    _collide(body, cylinder, PERSON_FRICTION)
    return skeleton


def build_legs() -> Any:
    """Return the skeleton of a person with joints: one body for each of `LEGS`.

    Each body has six positions: a rotation vector [rad] and the middle [m]. It moves at the
    commanded velocity, independent of contacts.
    """
    skeleton = dart.dynamics.Skeleton("person")
    for _ in LEGS:
        joint, body = skeleton.createFreeJointAndBodyNodePair()
        joint.setActuatorType(dart.dynamics.VELOCITY)
        _collide(body, dart.dynamics.CapsuleShape(0.1, 0.1), PERSON_FRICTION)
    return skeleton


def _collide(
    body: Any,
    shape: Any,
    friction: float,
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Any:
    node = body.createShapeNode(shape)
    node.setRelativeTranslation(offset)
    node.createCollisionAspect()
    node.createDynamicsAspect().setFrictionCoeff(friction)
    return node


def _planar(pose: Pose2D, z: float) -> Any:
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    rotation = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
    return dart.math.Isometry3(rotation, [pose.x, pose.y, z])
