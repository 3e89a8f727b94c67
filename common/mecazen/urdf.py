"""The robot's description: its URDF with meshes, as built, as served on the bus, and as read."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import pairwise
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from mecazen.arrays import quaternions_of_rpy, turn
from mecazen.bus import Bus
from mecazen.errors import ConfigError, RefusedError
from mecazen.keys import ROBOT_DESCRIPTION, call_of_robot
from mecazen.links import RobotLink, base_link, hub_radius, robot_links
from mecazen.messages import Empty, String
from mecazen.portable import Floats
from mecazen.robot import Robot
from mecazen.rollers import Roller, binary_stl

Vector = tuple[float, float, float]
Shape = tuple[str, dict[str, str]]
"""A shape's element and its attributes."""

ZERO: Vector = (0.0, 0.0, 0.0)
ROLLER_MESH = "meshes/roller.stl"
"""The one mesh of all rollers: a body of revolution is its own mirror image."""
COLOURS = {
    "base": "0.98 0.80 0.36 1",
    "hub": "0.55 0.57 0.60 1",
    "roller": "0.10 0.10 0.10 1",
    "sensor": "0.17 0.19 0.22 1",
    "payload": "0.60 0.45 0.25 1",
}
SIZES = {"box": (("size",), 3), "cylinder": (("radius", "length"), 2), "mesh": ((), 0)}
"""Attributes with the size of each shape that is read, and the count of numbers in them."""
GREY = (0.5, 0.5, 0.5, 1.0)
MAX_JOINTS = 1000
"""Maximum number of joints that are read; a robot with 40 rollers in each wheel has 167."""


class RobotDescription(NamedTuple):
    """A robot's URDF and its meshes."""

    urdf: str
    meshes: Mapping[str, bytes]
    """Files by the names that the URDF gives them."""


def serve_description(bus: Bus, robot: str, description: RobotDescription) -> None:
    """Answer queries on `robot_description` with the URDF, and below it with the meshes."""
    call, urdf = call_of_robot(ROBOT_DESCRIPTION, robot), String(data=description.urdf)
    bus.serve(call, lambda _, reply: reply.answer(urdf))
    bus.serve_files(call.key, description.meshes)


def ask_description(bus: Bus, robot: str, timeout_s: float) -> RobotDescription:
    """Return the description that a service gives of a robot.

    Raises:
        BusError: No service answers.
    """
    call = call_of_robot(ROBOT_DESCRIPTION, robot)
    urdf = bus.call(call, Empty(), timeout_s).data
    files = bus.fetch_files(f"{call.key}/*/**", timeout_s)
    return RobotDescription(
        urdf, {name.removeprefix(f"{call.key}/"): data for name, data in files.items()}
    )


def build_meshes(robot: Robot) -> dict[str, bytes]:
    """Return the files that `build_urdf` refers to, by the names used there: binary STL [m]."""
    return {ROLLER_MESH: binary_stl(*Roller.from_robot(robot).mesh())}


@cache
def build_urdf(robot: Robot, base_frame: str = "base_link") -> str:
    """Return the URDF of `robot`, with the joints of the joint states.

    A base frame with another name than base_link is its parent, at the same place. Building takes
    longer than a tick and any client may request the URDF, so it is cached.

    Raises:
        ConfigError: The base frame has the name of another link.
    """
    root = ET.Element("robot", name=robot.name)
    for name, rgba in COLOURS.items():
        ET.SubElement(ET.SubElement(root, "material", name=name), "color", rgba=rgba)
    box = robot.base
    base = base_link(robot)
    _add_link(root, base, _box(box.length_m, box.width_m, box.height_m), "base", xyz=base.centre)
    hub = _cylinder(hub_radius(robot), robot.wheels.hub_width_m)
    barrel = ("mesh", {"filename": ROLLER_MESH})
    for link in robot_links(robot):
        if robot.camera is not None and link.name == robot.camera.frame:
            _add_link(root, link, _box(*robot.camera.size_m), "sensor")
        elif robot.lidar is not None and link.name == robot.lidar.frame:
            _add_link(root, link, _cylinder(*robot.lidar.size_m), "sensor")
        elif robot.payload is not None and link.name == "payload_link":
            _add_link(root, link, _box(*robot.payload.size_m), "payload")
        elif link.parent == "base_link":
            _add_link(root, link, hub, "hub", rpy=(math.pi / 2, 0.0, 0.0))
        else:
            _add_link(root, link, barrel, "roller")
        _add_moving_joint(root, link, robot)
    if robot.camera is not None:
        # by REP-103: z ahead, x to the right, y down; the housing stays level
        ahead, left, up = np.array(robot.camera.axes)
        rpy = _roll_pitch_yaw(np.column_stack([-left, -up, ahead]))
        optical = robot.camera.optical_frame
        ET.SubElement(root, "link", name=optical)
        joint = _add_joint(root, "camera_depth_optical_joint", robot.camera.frame, optical)
        ET.SubElement(joint, "origin", xyz=_numbers(*ZERO), rpy=_numbers(*rpy))
    if base_frame != base.name:
        if base_frame in {link.get("name") for link in root.iterfind("link")}:
            raise ConfigError(
                f"controller.base_frame_id: {base_frame} is another link of the robot"
            )
        ET.SubElement(root, "link", name=base_frame)
        _add_joint(root, f"{base_frame}_joint", base_frame, base.name)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True)


def _add_link(
    root: ET.Element,
    link: RobotLink,
    shape: Shape,
    material: str,
    *,
    xyz: Vector = ZERO,
    rpy: Vector = ZERO,
) -> None:
    element = ET.SubElement(root, "link", name=link.name)
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=_numbers(*link.centre), rpy=_numbers(*ZERO))
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


def _add_joint(
    root: ET.Element, name: str, parent: str, child: str, kind: str = "fixed"
) -> ET.Element:
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    return joint


def _add_moving_joint(root: ET.Element, link: RobotLink, robot: Robot) -> None:
    kind = "fixed" if link.axis is None else "continuous"
    joint = _add_joint(root, link.joint, link.parent, link.name, kind)
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


def _box(length: float, width: float, height: float) -> Shape:
    return "box", {"size": _numbers(length, width, height)}


def _cylinder(radius: float, height: float) -> Shape:
    return "cylinder", {"radius": _numbers(radius), "length": _numbers(height)}


def _numbers(*values: float) -> str:
    """Return the numbers as a list in URDF; adding zero removes the sign of -0."""
    return " ".join(f"{value + 0.0:.12g}" for value in values)


def _roll_pitch_yaw(r: Floats) -> Vector:
    """Return the angles [rad] of R = Rz(yaw)·Ry(pitch)·Rx(roll); no link is near pitch ±90°."""
    roll, yaw = math.atan2(r[2, 1], r[2, 2]), math.atan2(r[1, 0], r[0, 0])
    return roll, math.asin(-r[2, 0]), yaw


class Origin(NamedTuple):
    """A frame in its parent: xyz [m]; roll, pitch, yaw [rad] about the parent's fixed axes."""

    xyz: Vector = ZERO
    rpy: Vector = ZERO


class Visual(NamedTuple):
    """The shape of a link."""

    kind: str
    """box, cylinder or mesh."""
    size: tuple[float, ...]
    """A box: length, width, height. A cylinder: radius, length [m]."""
    mesh: str
    """File name of a mesh, whose coordinates are in the link's frame."""
    origin: Origin
    """Pose of a box or cylinder in the link's frame."""
    rgba: tuple[float, ...]


class Joint(NamedTuple):
    """The joint between a link and its parent."""

    name: str
    kind: str
    """fixed, continuous, revolute or another of URDF's."""
    parent: str
    child: str
    origin: Origin
    """The child's frame in the parent's, at position 0."""
    axis: Vector | None
    """Axis in the child's frame, about which the joint turns; None for a fixed joint."""


class Urdf(NamedTuple):
    """The links and joints of a robot."""

    visuals: Mapping[str, Visual]
    """Visuals by link; only of links that have one."""
    joints: tuple[Joint, ...]


def read(text: str) -> Urdf:
    """Return the robot that `text` describes.

    Raises:
        RefusedError: The text is not a URDF.
    """
    try:
        # expat limits the expansion of entities, the usual attack by XML
        root = ET.fromstring(text)  # noqa: S314
        colours = {
            material.get("name"): _floats(_child(material, "color").get("rgba", ""), 4)
            for material in root.findall("material")
        }
        visuals = {
            link.get("name", ""): _visual(visual, colours)
            for link in root.findall("link")
            if (visual := link.find("visual")) is not None
        }
        joints = tuple(map(_joint, root.findall("joint")))
    except (ET.ParseError, RefusedError) as error:
        raise RefusedError(f"not a URDF: {error}") from None
    if len(joints) > MAX_JOINTS:
        raise RefusedError(f"{len(joints)} joints; at most {MAX_JOINTS} are drawn")
    return Urdf(visuals, joints)


def _joint(element: ET.Element) -> Joint:
    axis = element.find("axis")
    return Joint(
        name=element.get("name", ""),
        kind=element.get("type", ""),
        parent=_child(element, "parent").get("link", ""),
        child=_child(element, "child").get("link", ""),
        origin=_read_origin(element),
        axis=None if axis is None else _vector(axis, "xyz", "1 0 0"),
    )


def _visual(visual: ET.Element, colours: Mapping[str | None, tuple[float, ...]]) -> Visual:
    geometry = _child(visual, "geometry")
    if not len(geometry):
        raise RefusedError("an empty geometry")
    shape = geometry[0]
    if shape.tag not in SIZES:
        raise RefusedError(f"the shape {shape.tag!r}")
    names, count = SIZES[shape.tag]
    size = _floats(" ".join(shape.get(name, "") for name in names), count)
    material = visual.find("material")
    rgba = colours.get(None if material is None else material.get("name"), GREY)
    return Visual(shape.tag, size, shape.get("filename", ""), _read_origin(visual), rgba)


def _read_origin(element: ET.Element) -> Origin:
    """Return the origin of an element; by default it is the frame of the parent."""
    origin = element.find("origin")
    return Origin() if origin is None else Origin(_vector(origin, "xyz"), _vector(origin, "rpy"))


def _child(element: ET.Element, tag: str) -> ET.Element:
    child = element.find(tag)
    if child is None:
        raise RefusedError(f"{element.tag} {element.get('name', '')} without {tag}")
    return child


def _vector(element: ET.Element, name: str, default: str = "0 0 0") -> Vector:
    x, y, z = _floats(element.get(name, default), 3)
    return x, y, z


def _floats(text: str, count: int) -> tuple[float, ...]:
    words = text.split()
    try:
        numbers = tuple(map(float, words))
    except ValueError as error:
        raise RefusedError(str(error)) from None
    if len(numbers) != count:
        raise RefusedError(f"{text!r:.80} must be {count} numbers")
    return numbers


def portable_urdf(urdf: str, meshes: Mapping[str, bytes]) -> str:
    """Return a URDF with cylinders in place of some meshes, STL of bodies about z as rollers are.

    ROS fetches no file from Zenoh, and a `package://` opens only where that package is installed.
    """
    root = ET.fromstring(urdf)  # noqa: S314 - of our own making, or of a world of the user's own
    for link in root.iterfind("link"):
        for part in [*link.iterfind("visual"), *link.iterfind("collision")]:
            mesh = part.find("geometry/mesh")
            stl = None if mesh is None else meshes.get(mesh.get("filename", ""))
            if stl is not None:
                link.remove(part)
                link.extend(_cylinders(part, stl))
    return ET.tostring(root, encoding="unicode", xml_declaration=True)


def _cylinders(part: ET.Element, stl: bytes) -> Iterator[ET.Element]:
    """Yield five copies of a link's part, with cylinders that enclose its mesh."""
    facets = np.frombuffer(stl[84:], dtype=[("corners", "<f4", (4, 3)), ("", "<u2")])
    corners = facets["corners"][:, 1:].astype(float)  # after the normal
    radii = np.hypot(corners[..., 0], corners[..., 1]).max(axis=1)
    lowest, highest = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    origin = _read_origin(part)
    for low, high in pairwise(np.linspace(lowest.min(), highest.max(), 6)):
        xyz = origin.xyz + turn(quaternions_of_rpy(origin.rpy), (0.0, 0.0, (low + high) / 2))
        radius = radii[(lowest <= high) & (highest >= low)].max(initial=0.0)
        copied = ET.Element(part.tag)
        ET.SubElement(copied, "origin", {"xyz": _numbers(*xyz), "rpy": _numbers(*origin.rpy)})
        size = {"radius": _numbers(radius), "length": _numbers(high - low)}
        ET.SubElement(ET.SubElement(copied, "geometry"), "cylinder", size)
        copied.extend(part.findall("material"))
        yield copied
