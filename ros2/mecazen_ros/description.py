"""The robot's URDF as ROS needs it: shapes that open anywhere, and the frames of its joints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from mecazen.messages import Header, JointState, Quaternion, Time, Vector3
from mecazen.rotation import Array, about, from_rpy, multiply, rotate
from mecazen.urdf import Joint, Vector, read, read_origin

from mecazen_ros.interfaces import message

TFMessage, Transform = message("TFMessage"), message("Transform")
TransformStamped = message("TransformStamped")
SLICES = 5
"""Number of cylinders that replace a mesh."""
MOVING_HZ = 25.0
"""Rate at which the frames of moving joints are published, which suffices for the eye. All 40
joints of a robot take 0.25 ms, so at every tick they would take 2.5 % of a core."""


def fixed_frames(urdf: str, prefix: str) -> Any:
    """Return the frames of links fixed to other links; `prefix` begins each frame's name."""
    fixed = [joint for joint in read(urdf).joints if joint.kind == "fixed"]
    return _frames(fixed, from_rpy(_vectors(joint.origin.rpy for joint in fixed)), Time(), prefix)


class MovingFrames:
    """The frames of the joints that turn, from their positions, `MOVING_HZ` times a second."""

    def __init__(self, urdf: str, prefix: str) -> None:
        turning = [one for one in read(urdf).joints if one.kind in ("continuous", "revolute")]
        axes = _vectors(joint.axis or (1.0, 0.0, 0.0) for joint in turning)
        self._joints = turning
        self._numbers = {joint.name: number for number, joint in enumerate(turning)}
        self._rotations = from_rpy(_vectors(joint.origin.rpy for joint in turning))
        self._axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        self._prefix = prefix
        self._last_ns = -1

    def __call__(self, state: JointState) -> Any:
        """Return the frames for joint positions; None if the next frames are not due yet."""
        time = state.header.stamp
        # simulated time that goes back begins another run
        if 0 <= time.ns - self._last_ns < 1e9 / MOVING_HZ and self._last_ns >= 0:
            return None
        self._last_ns = time.ns
        positions = {
            self._numbers[name]: position
            for name, position in zip(state.name, state.position, strict=False)
            if name in self._numbers
        }
        moved = list(positions)
        turns = about(self._axes[moved], list(positions.values()))
        rotations = multiply(self._rotations[moved], turns)
        return _frames([self._joints[n] for n in moved], rotations, time, self._prefix)


def _frames(joints: Sequence[Joint], rotations: Array, time: Time, prefix: str) -> Any:
    """Return the frames of the joints' child links, turned by rotations (N, 4)."""
    return TFMessage(
        transforms=tuple(
            TransformStamped(
                header=Header(stamp=time, frame_id=prefix + joint.parent),
                child_frame_id=prefix + joint.child,
                transform=Transform(Vector3(*joint.origin.xyz), Quaternion(*rotation)),
            )
            for joint, rotation in zip(joints, rotations.tolist(), strict=True)
        )
    )


def _vectors(vectors: Iterable[Vector]) -> Array:
    return np.array(list(vectors)).reshape(-1, 3)


def portable(urdf: str, meshes: Mapping[str, bytes]) -> str:
    """Return a URDF in which cylinders replace the meshes that are in `meshes`.

    ROS fetches no file from Zenoh, and a `package://` opens only where that package is installed.

    Args:
        urdf: The URDF, which names its meshes by relative paths.
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
    """Return a part of a link in which a cylinder about the part's z axis replaces the shape."""
    made = ET.Element(part.tag)
    origin = read_origin(part)
    xyz = origin.xyz + rotate(from_rpy(origin.rpy), (0.0, 0.0, middle))
    ET.SubElement(made, "origin", {"xyz": _text(*xyz), "rpy": _text(*origin.rpy)})
    size = {"radius": _text(radius), "length": _text(length)}
    ET.SubElement(ET.SubElement(made, "geometry"), "cylinder", size)
    made.extend(part.findall("material"))
    return made


def _slices(stl: bytes) -> Iterator[tuple[float, float, float]]:
    """Yield middle, radius and length of slices that enclose a body of revolution about z [m]."""
    facets = np.frombuffer(stl[84:], dtype=[("corners", "<f4", (4, 3)), ("attribute", "<u2")])
    corners = facets["corners"][:, 1:].astype(float)  # after the normal
    radii = np.hypot(corners[..., 0], corners[..., 1]).max(axis=1)
    lowest, highest = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    edges = np.linspace(lowest.min(), highest.max(), SLICES + 1)
    for low, high in pairwise(edges.tolist()):
        inside = radii[(lowest <= high) & (highest >= low)]
        yield (low + high) / 2, float(inside.max(initial=0.0)), high - low


def _text(*values: float) -> str:
    return " ".join(f"{value:.9g}" for value in values)
