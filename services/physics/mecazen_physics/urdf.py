"""The robot as a URDF, for viewers and other tools."""

from __future__ import annotations

import math
from functools import cache
from xml.etree import ElementTree as ET

import numpy as np
from mecazen.errors import ConfigError
from mecazen.robot import Robot

from mecazen_physics import model
from mecazen_physics.model import Array, Link
from mecazen_physics.rollers import Roller, binary_stl

ROLLER_MESH = "meshes/roller.stl"
"""The one mesh of all rollers: a body of revolution is its own mirror image."""

_COLOURS = {
    "base": "0.20 0.22 0.26 1",
    "hub": "0.55 0.57 0.60 1",
    "roller": "0.10 0.10 0.10 1",
    "sensor": "0.05 0.35 0.65 1",
    "payload": "0.60 0.45 0.25 1",
}

Shape = tuple[str, dict[str, str]]


def meshes(robot: Robot) -> dict[str, bytes]:
    """Return the files that `build_urdf` refers to, by the names used there: binary STL [m]."""
    return {ROLLER_MESH: binary_stl(*Roller.of(robot).mesh())}


@cache
def build_urdf(robot: Robot, base_frame: str = "base_link") -> str:
    """Return the URDF of `robot`, with the joints of `SimulatedRobot.joint_names`.

    A base frame with another name than base_link is its parent, at the same place. Building takes
    longer than a tick and any client may request the URDF, so it is cached.

    Raises:
        ConfigError: The base frame has the name of another link.
    """
    root = ET.Element("robot", name=robot.name)
    for name, rgba in _COLOURS.items():
        ET.SubElement(ET.SubElement(root, "material", name=name), "color", rgba=rgba)
    box = robot.base
    base = model.base(robot)
    _add_link(root, base, _box(box.length_m, box.width_m, box.height_m), "base", xyz=base.centre)
    hub = _cylinder(model.hub_radius(robot), robot.wheels.hub_width_m)
    barrel = ("mesh", {"filename": ROLLER_MESH})
    for link in model.links(robot):
        if link.name == "camera_link":
            _add_link(root, link, _box(*robot.camera.size_m), "sensor")
        elif link.name == "lidar_link":
            _add_link(root, link, _cylinder(*robot.lidar.size_m), "sensor")
        elif link.name == "payload_link" and robot.payload is not None:
            _add_link(root, link, _box(*robot.payload.size_m), "payload")
        elif link.parent == "base_link":
            _add_link(root, link, hub, "hub", rpy=(math.pi / 2, 0.0, 0.0))
        else:
            _add_link(root, link, barrel, "roller")
        _add_joint(root, link, robot)
    _add_optical_frame(root, robot)
    if base_frame != base.name:
        if base_frame in {link.get("name") for link in root.iterfind("link")}:
            raise ConfigError(
                f"controller.base_frame_id: {base_frame} is another link of the robot"
            )
        ET.SubElement(root, "link", name=base_frame)
        joint = ET.SubElement(root, "joint", name=f"{base_frame}_joint", type="fixed")
        ET.SubElement(joint, "parent", link=base_frame)
        ET.SubElement(joint, "child", link=base.name)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True)


def _add_link(
    root: ET.Element,
    link: Link,
    shape: Shape,
    material: str,
    *,
    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> None:
    element = ET.SubElement(root, "link", name=link.name)
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=_numbers(*link.centre), rpy=_numbers(0.0, 0.0, 0.0))
    ET.SubElement(inertial, "mass", value=_numbers(link.mass))
    xx, yy, zz = map(_numbers, link.moments)
    ET.SubElement(inertial, "inertia", ixx=xx, iyy=yy, izz=zz, ixy="0", ixz="0", iyz="0")
    for purpose in ("visual", "collision"):
        part = ET.SubElement(element, purpose)
        ET.SubElement(part, "origin", xyz=_numbers(*xyz), rpy=_numbers(*rpy))
        tag, attributes = shape
        ET.SubElement(ET.SubElement(part, "geometry"), tag, attributes)
        if purpose == "visual":
            ET.SubElement(part, "material", name=material)


def _add_joint(root: ET.Element, link: Link, robot: Robot) -> None:
    kind = "fixed" if link.axis is None else "continuous"
    joint = ET.SubElement(root, "joint", name=link.joint, type=kind)
    ET.SubElement(joint, "parent", link=link.parent)
    ET.SubElement(joint, "child", link=link.name)
    angles = _roll_pitch_yaw(link.rotation)
    ET.SubElement(joint, "origin", xyz=_numbers(*link.translation), rpy=_numbers(*angles))
    if link.axis is None:
        return
    ET.SubElement(joint, "axis", xyz=_numbers(*link.axis))
    if link.parent == "base_link":
        torque, speed = robot.wheels.max_torque_nm, robot.wheels.max_speed_rad_s
        ET.SubElement(joint, "limit", effort=_numbers(torque), velocity=_numbers(speed))
    else:
        ET.SubElement(joint, "dynamics", damping=_numbers(robot.rollers.bearing_friction_nms))


def _add_optical_frame(root: ET.Element, robot: Robot) -> None:
    """Add the optical frame of the camera by REP-103: z ahead, x to the right, y down.

    The housing, camera_link, stays level.
    """
    name = "camera_depth_optical_frame"
    ET.SubElement(root, "link", name=name)
    joint = ET.SubElement(root, "joint", name="camera_depth_optical_joint", type="fixed")
    ET.SubElement(joint, "parent", link="camera_link")
    ET.SubElement(joint, "child", link=name)
    ahead, left, up = np.array(robot.camera.axes)
    angles = _roll_pitch_yaw(np.column_stack([-left, -up, ahead]))
    ET.SubElement(joint, "origin", xyz=_numbers(0.0, 0.0, 0.0), rpy=_numbers(*angles))


def _box(length: float, width: float, height: float) -> Shape:
    return "box", {"size": _numbers(length, width, height)}


def _cylinder(radius: float, height: float) -> Shape:
    return "cylinder", {"radius": _numbers(radius), "length": _numbers(height)}


def _numbers(*values: float) -> str:
    """Return the numbers as a list in URDF; adding zero removes the sign of -0."""
    return " ".join(f"{value + 0.0:.12g}" for value in values)


def _roll_pitch_yaw(rotation: Array) -> tuple[float, float, float]:
    """Return the angles [rad] of R = Rz(yaw)·Ry(pitch)·Rx(roll); no link is near pitch ±90°."""
    r = rotation
    return (
        math.atan2(r[2, 1], r[2, 2]),
        math.asin(-r[2, 0]),
        math.atan2(r[1, 0], r[0, 0]),
    )
