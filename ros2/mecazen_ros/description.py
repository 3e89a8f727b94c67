"""The robot's URDF as ROS needs it: shapes that open anywhere, and the frames of its joints."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from mecazen.messages import Header, JointState, Quaternion, Time, Vector3

from mecazen_ros.interfaces import message

TFMessage, Transform = message("TFMessage"), message("Transform")
TransformStamped = message("TransformStamped")
SLICES = 5
"""A mesh is shown as so many cylinders."""
MOVING_HZ = 25.0
"""How often the frames of moving joints are published: what an eye needs. All 40 of a robot take
0.25 ms, so at every tick they would take 2.5 % of a core."""

Rotation = tuple[float, float, float, float]
"""A unit quaternion: x, y, z, w."""


class Joint(NamedTuple):
    """Where a joint has its child in its parent's frame, at position 0."""

    name: str
    parent: str
    child: str
    translation: Vector3
    rotation: Rotation
    axis: tuple[float, float, float] | None
    """A unit vector that the child turns about; None of a fixed joint."""

    def transform(self, position: float, time: Time, prefix: str) -> Any:
        """Return where the child is with the joint at `position` [rad]."""
        rotation = self.rotation
        if self.axis is not None:
            s, c = math.sin(position / 2), math.cos(position / 2)
            ax, ay, az = self.axis
            rotation = _product(rotation, (ax * s, ay * s, az * s, c))
        return TransformStamped(
            header=Header(stamp=time, frame_id=prefix + self.parent),
            child_frame_id=prefix + self.child,
            transform=Transform(translation=self.translation, rotation=Quaternion(*rotation)),
        )


def joints(urdf: str) -> list[Joint]:
    """Return the fixed joints of a URDF, and those that turn."""
    return [_joint(one) for one in _root(urdf).iterfind("joint") if _turns(one) is not None]


def fixed_frames(urdf: str, prefix: str) -> Any:
    """Return where links are that are fixed to others; `prefix` begins each frame's name."""
    fixed = (joint for joint in joints(urdf) if joint.axis is None)
    return TFMessage(transforms=tuple(joint.transform(0.0, Time(), prefix) for joint in fixed))


class MovingFrames:
    """The frames of the joints that turn, from their positions, `MOVING_HZ` times a second."""

    def __init__(self, urdf: str, prefix: str) -> None:
        self._joints = {joint.name: joint for joint in joints(urdf) if joint.axis is not None}
        self._prefix = prefix
        self._last_ns = -1

    def __call__(self, state: JointState) -> Any:
        """Return the frames at some positions; None where it is too soon for them."""
        time = state.header.stamp
        # simulated time that goes back begins another run
        if 0 <= time.ns - self._last_ns < 1e9 / MOVING_HZ and self._last_ns >= 0:
            return None
        self._last_ns = time.ns
        moved = zip(state.name, state.position, strict=False)
        return TFMessage(
            transforms=tuple(
                self._joints[name].transform(position, time, self._prefix)
                for name, position in moved
                if name in self._joints
            )
        )


def portable(urdf: str, meshes: Mapping[str, bytes]) -> str:
    """Return a URDF in which cylinders stand for the meshes of some names.

    ROS fetches no file from Zenoh, and a `package://` opens only where that package is installed.

    Args:
        urdf: Names its meshes by relative paths.
        meshes: Their binary STL [m]: bodies of revolution about z, as rollers are.
    """
    root = _root(urdf)
    cylinders = {name: list(_slices(stl)) for name, stl in meshes.items()}
    for link in root.iterfind("link"):
        for part in [*link.iterfind("visual"), *link.iterfind("collision")]:
            mesh = part.find("geometry/mesh")
            name = "" if mesh is None else mesh.get("filename", "")
            if name in cylinders:
                link.remove(part)
                for middle, radius, length in cylinders[name]:
                    link.append(_cylinder(part, middle, radius, length))
    return ET.tostring(root, encoding="unicode", xml_declaration=True)


def _cylinder(part: ET.Element, middle: float, radius: float, length: float) -> ET.Element:
    """Return a part of a link with a cylinder about its z axis in the place of its shape."""
    made = ET.Element(part.tag)
    origin = _origin(part)
    turned = _turned(_quaternion(*_numbers(origin, "rpy")), (0.0, 0.0, middle))
    xyz = [a + b for a, b in zip(_numbers(origin, "xyz"), turned, strict=True)]
    attributes = {"xyz": _text(*xyz), "rpy": _text(*_numbers(origin, "rpy"))}
    ET.SubElement(made, "origin", attributes)
    size = {"radius": _text(radius), "length": _text(length)}
    ET.SubElement(ET.SubElement(made, "geometry"), "cylinder", size)
    made.extend(part.findall("material"))
    return made


def _slices(stl: bytes) -> Iterator[tuple[float, float, float]]:
    """Yield middle, radius and length of the slices of a body about z [m]; each holds its part."""
    facets = np.frombuffer(stl[84:], dtype=[("corners", "<f4", (4, 3)), ("attribute", "<u2")])
    corners = facets["corners"][:, 1:].astype(float)  # after the normal
    radii = np.hypot(corners[..., 0], corners[..., 1]).max(axis=1)
    lowest, highest = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    edges = np.linspace(lowest.min(), highest.max(), SLICES + 1)
    for low, high in pairwise(edges.tolist()):
        inside = radii[(lowest <= high) & (highest >= low)]
        yield (low + high) / 2, float(inside.max(initial=0.0)), high - low


def _root(urdf: str) -> ET.Element:
    return ET.fromstring(urdf)  # noqa: S314 - of our own making, or of a world of the user's own


def _turns(joint: ET.Element) -> bool | None:
    """Return whether a joint turns; None of those that neither turn nor are fixed."""
    return {"fixed": False, "continuous": True, "revolute": True}.get(joint.get("type", ""))


def _joint(element: ET.Element) -> Joint:
    parent, child = (_link(element, tag) for tag in ("parent", "child"))
    origin = _origin(element)
    axis = None
    if _turns(element):
        given = element.find("axis")
        x, y, z = _numbers(given, "xyz") if given is not None else (1.0, 0.0, 0.0)
        length = math.hypot(x, y, z)
        axis = x / length, y / length, z / length
    translation = Vector3(*_numbers(origin, "xyz"))
    rotation = _quaternion(*_numbers(origin, "rpy"))
    return Joint(element.get("name", ""), parent, child, translation, rotation, axis)


def _link(joint: ET.Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.get("link", "")


def _origin(element: ET.Element) -> ET.Element:
    origin = element.find("origin")
    return ET.Element("origin") if origin is None else origin


def _numbers(element: ET.Element, name: str) -> tuple[float, float, float]:
    x, y, z = map(float, element.get(name, "0 0 0").split())
    return x, y, z


def _text(*values: float) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _quaternion(roll: float, pitch: float, yaw: float) -> Rotation:
    """Return Rz(yaw)·Ry(pitch)·Rx(roll)."""
    about_x = math.sin(roll / 2), 0.0, 0.0, math.cos(roll / 2)
    about_y = 0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2)
    about_z = 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)
    return _product(_product(about_z, about_y), about_x)


def _product(a: Rotation, b: Rotation) -> Rotation:
    """Return the rotation `b` followed by `a`: Hamilton's product."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _turned(rotation: Rotation, vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return a vector turned by a rotation."""
    x, y, z, w = rotation
    turned = _product(_product(rotation, (*vector, 0.0)), (-x, -y, -z, w))
    return turned[:3]
