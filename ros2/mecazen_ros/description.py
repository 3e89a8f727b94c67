"""The robot's URDF as ROS needs it: shapes that open anywhere, and the frames of its joints."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from mecazen.messages import Header, JointState, Quaternion, Time, Vector3
from mecazen.urdf import Joint, Vector, read, read_origin

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


def fixed_frames(urdf: str, prefix: str) -> Any:
    """Return where links are that are fixed to others; `prefix` begins each frame's name."""
    fixed = [joint for joint in read(urdf).joints if joint.kind == "fixed"]
    return TFMessage(
        transforms=tuple(
            _frame(joint, _quaternion(*joint.origin.rpy), Time(), prefix) for joint in fixed
        )
    )


def _frame(joint: Joint, rotation: Rotation, time: Time, prefix: str) -> Any:
    """Return where a joint has its child, turned by a rotation."""
    return TransformStamped(
        header=Header(stamp=time, frame_id=prefix + joint.parent),
        child_frame_id=prefix + joint.child,
        transform=Transform(Vector3(*joint.origin.xyz), Quaternion(*rotation)),
    )


class MovingFrames:
    """The frames of the joints that turn, from their positions, `MOVING_HZ` times a second."""

    def __init__(self, urdf: str, prefix: str) -> None:
        self._joints = {
            one.name: (one, _quaternion(*one.origin.rpy), _unit(one.axis or (1.0, 0.0, 0.0)))
            for one in read(urdf).joints
            if one.kind in ("continuous", "revolute")
        }
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
                self._turned(name, position, time)
                for name, position in moved
                if name in self._joints
            )
        )

    def _turned(self, name: str, position: float, time: Time) -> Any:
        joint, rotation, axis = self._joints[name]
        s, c = math.sin(position / 2), math.cos(position / 2)
        x, y, z = (part * s for part in axis)
        return _frame(joint, _product(rotation, (x, y, z, c)), time, self._prefix)


def portable(urdf: str, meshes: Mapping[str, bytes]) -> str:
    """Return a URDF in which cylinders stand for the meshes of some names.

    ROS fetches no file from Zenoh, and a `package://` opens only where that package is installed.

    Args:
        urdf: Names its meshes by relative paths.
        meshes: Their binary STL [m]: bodies of revolution about z, as rollers are.
    """
    root = ET.fromstring(urdf)  # noqa: S314 - of our own making, or of a world of the user's own
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
    origin = read_origin(part)
    turned = _turned(_quaternion(*origin.rpy), (0.0, 0.0, middle))
    xyz = [a + b for a, b in zip(origin.xyz, turned, strict=True)]
    ET.SubElement(made, "origin", {"xyz": _text(*xyz), "rpy": _text(*origin.rpy)})
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


def _unit(vector: Vector) -> Vector:
    x, y, z = vector
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length


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


def _turned(rotation: Rotation, vector: Vector) -> Vector:
    """Return a vector turned by a rotation."""
    x, y, z, w = rotation
    turned = _product(_product(rotation, (*vector, 0.0)), (-x, -y, -z, w))
    return turned[:3]
