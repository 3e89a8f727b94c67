"""The robot as a tree of rigid links, from which the simulated world and the URDF are built."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mecazen.portable import Floats, product
from mecazen.robot import WHEELS, Attachment, Payload, Robot, roller_joint
from mecazen.rollers import Roller


@dataclass(frozen=True)
class RobotLink:
    """A rigid body and the joint that connects it to its parent.

    The joint's frame is the link's frame; `translation` (3,) [m] and `rotation` (3, 3) place it in
    the parent's frame. `axis` (3,) is the axis of a revolute joint in the link's frame, None for a
    fixed joint. The centre of mass is at `centre` (3,) [m] in the link's frame; `moments` are the
    principal moments of inertia about the centre of mass [kg·m²], along the link's axes.
    """

    name: str
    parent: str
    joint: str
    translation: tuple[float, float, float]
    rotation: Floats
    axis: tuple[float, float, float] | None
    mass: float
    moments: tuple[float, float, float]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)


def hub_radius(robot: Robot) -> float:
    """Return the radius of the hub, the cylinder inside the rollers [m]."""
    return robot.wheels.radius_m - 2.0 * robot.rollers.max_radius_m


def base_link(robot: Robot) -> RobotLink:
    """Return base_link, the root; it has no parent."""
    box = robot.base
    centre = (*robot.wheels.centre_m, box.clearance_m + box.height_m / 2)
    moments = _box(box.mass_kg, box.length_m, box.width_m, box.height_m)
    identity = np.eye(3)
    return RobotLink(
        "base_link", "", "", (0.0, 0.0, 0.0), identity, None, box.mass_kg, moments, centre
    )


@lru_cache
def robot_links(robot: Robot) -> tuple[RobotLink, ...]:
    """Return all links but the base: wheels, rollers, then camera, lidar and payload.

    Wheels and rollers come in the order of the joint states.
    """
    wheels = [_wheel(robot, wheel) for wheel in WHEELS]
    shape = Roller.from_robot(robot)
    sign = math.copysign(1.0, robot.cross_gain)
    sides = [sign * (-1.0 if number in {1, 4} else 1.0) for number in robot.wheels.mounting]
    rollers = [
        _roller(shape, wheel, side, index)
        for wheel, side in zip(WHEELS, sides, strict=True)
        for index in range(shape.count)
    ]
    fixed = []
    if (camera := robot.camera) is not None:
        moments = _box(camera.mass_kg, *camera.size_m)
        fixed.append(_attachment("camera", camera.frame, camera, moments))
    if (lidar := robot.lidar) is not None:
        across, along = _cylinder(lidar.mass_kg, *lidar.size_m)
        fixed.append(_attachment("lidar", lidar.frame, lidar, (across, across, along)))
    if (load := robot.payload) is not None:
        moments = _box(load.mass_kg, *load.size_m)
        fixed.append(_attachment("payload", "payload_link", load, moments))
    return (*wheels, *rollers, *fixed)


def lump(parts: Sequence[RobotLink]) -> tuple[float, Floats, Floats]:
    """Return mass [kg], centre of mass (3,) [m] and inertia about it (3, 3) [kg·m²] of `parts`.

    The result is in the frame in which the parts are placed, by the parallel axis theorem.
    """
    mass = math.fsum(part.mass for part in parts)
    places = [part.translation + product(part.rotation, part.centre) for part in parts]
    pairs = list(zip(parts, places, strict=True))
    centre = sum((part.mass * place for part, place in pairs), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for part, place in pairs:
        x, y, z = (place - centre).tolist()
        inertia += product(part.rotation * part.moments, part.rotation.T)
        inertia += part.mass * np.array(
            [
                [y * y + z * z, -x * y, -x * z],
                [-x * y, x * x + z * z, -y * z],
                [-x * z, -y * z, x * x + y * y],
            ]
        )
    return mass, centre, inertia


def _wheel(robot: Robot, wheel: str) -> RobotLink:
    mass = robot.wheels.hub_mass_kg
    across, along = _cylinder(mass, hub_radius(robot), robot.wheels.hub_width_m)
    return RobotLink(
        name=f"{wheel}_wheel",
        parent="base_link",
        joint=robot.wheels.joints[WHEELS.index(wheel)],
        translation=robot.wheel_position(wheel),
        rotation=np.eye(3),
        axis=(0.0, 1.0, 0.0),
        mass=mass,
        moments=(across, along, across),
    )


def _roller(roller: Roller, wheel: str, side: float, index: int) -> RobotLink:
    """Return roller `index` of `wheel`: index 0 is at the bottom, the next ones follow about +y.

    On the ground the axes of rollers with `side` -1 point forward and right, those with +1 forward
    and left. In the arrangement X the front left and rear right wheels have side -1: seen from
    above, the rollers on top form an X.
    """
    z = np.array([side * np.sin(roller.angle), np.cos(roller.angle), 0.0])
    y = np.array([0.0, 0.0, -1.0])
    turn = _about_y(2.0 * np.pi * index / roller.count)
    a, b, c = product(turn, (0.0, 0.0, -roller.axis_distance)).tolist()
    across, along = roller.inertia
    return RobotLink(
        name=f"{wheel}_roller_{index:02d}",
        parent=f"{wheel}_wheel",
        joint=roller_joint(wheel, index),
        translation=(a, b, c),
        rotation=product(turn, np.column_stack([np.cross(y, z), y, z])),
        axis=(0.0, 0.0, 1.0),
        mass=roller.mass,
        moments=(across, across, along),
    )


def _attachment(
    name: str, frame: str, part: Attachment | Payload, moments: tuple[float, float, float]
) -> RobotLink:
    place, joint = part.position_m, f"{name}_joint"
    return RobotLink(frame, "base_link", joint, place, np.eye(3), None, part.mass_kg, moments)


def _about_y(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _box(mass: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the principal moments of a box [kg·m²]."""
    return mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12


def _cylinder(mass: float, radius: float, height: float) -> tuple[float, float]:
    """Return the moments of a cylinder across and along its axis [kg·m²]."""
    return mass * (3 * radius**2 + height**2) / 12, mass * radius**2 / 2
