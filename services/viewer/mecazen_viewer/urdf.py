"""The drawn part of a URDF: coloured shapes, the joints between their links, and meshes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
import numpy.typing as npt
from mecazen.errors import RefusedError

Array = npt.NDArray[np.float32]

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)
SIZES = {"box": (("size",), 3), "cylinder": (("radius", "length"), 2), "mesh": ((), 0)}
"""Attributes with the size of each shape, and the count of numbers in them."""
GREY = (0.5, 0.5, 0.5, 1.0)
MAX_JOINTS = 1000
"""Maximum number of joints; a robot with 40 rollers in each wheel has 167."""
STL_HEADER_BYTES = 84
STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


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
    parent: str
    child: str
    origin: Origin
    """The child's frame in the parent's, at position 0."""
    axis: Vector | None
    """Axis in the child's frame; None for a fixed joint."""


class Urdf(NamedTuple):
    """A robot."""

    visuals: Mapping[str, Visual]
    """By link; only links that have one."""
    joints: tuple[Joint, ...]


def read(text: str) -> Urdf:
    """Return the robot that `text` describes.

    Raises:
        RefusedError: It is not a URDF.
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
        joints = [
            Joint(
                name=joint.get("name", ""),
                parent=_child(joint, "parent").get("link", ""),
                child=_child(joint, "child").get("link", ""),
                origin=_origin(joint),
                axis=None
                if (axis := joint.find("axis")) is None
                else _vector(axis, "xyz", "1 0 0"),
            )
            for joint in root.findall("joint")
        ]
    except (ET.ParseError, RefusedError) as error:
        raise RefusedError(f"not a URDF: {error}") from None
    if len(joints) > MAX_JOINTS:
        raise RefusedError(f"{len(joints)} joints; at most {MAX_JOINTS} are drawn")
    return Urdf(visuals, tuple(joints))


def read_stl(data: bytes) -> tuple[Array, npt.NDArray[np.uint32], Array]:
    """Return vertices (V, 3) [m], triangles (T, 3), and a normal for each vertex (V, 3).

    Coinciding corners are merged, which reduces the mesh to a sixth. The normal of a vertex is
    the mean of its facets' normals, weighted by area, so that the shading is smooth.

    Raises:
        RefusedError: It is not a binary STL file.
    """
    if len(data) < STL_HEADER_BYTES or (len(data) - STL_HEADER_BYTES) % STL_FACET.itemsize:
        raise RefusedError("not a binary STL file")
    corners = np.frombuffer(data, STL_FACET, offset=STL_HEADER_BYTES)["corners"]
    vertices: Array
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3)
    facets = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals: Array = np.zeros_like(vertices)
    np.add.at(normals, triangles, facets[:, np.newaxis])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(length > 0.0, length, 1.0)
    return vertices, triangles.astype(np.uint32), normals


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
    return Visual(shape.tag, size, shape.get("filename", ""), _origin(visual), rgba)


def _origin(element: ET.Element) -> Origin:
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
