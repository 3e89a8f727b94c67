"""The drawn part of a URDF: coloured shapes, and the joints between their links."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple
from xml.etree import ElementTree as ET

from mecazen.errors import RefusedError

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)
SIZES = {"box": (("size",), 3), "cylinder": (("radius", "length"), 2), "mesh": ((), 0)}
"""Attributes with the size of each shape, and the count of numbers in them."""
GREY = (0.5, 0.5, 0.5, 1.0)
MAX_JOINTS = 1000
"""Maximum number of joints; a robot with 40 rollers in each wheel has 167."""


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
        joints = [
            Joint(
                name=joint.get("name", ""),
                kind=joint.get("type", ""),
                parent=_child(joint, "parent").get("link", ""),
                child=_child(joint, "child").get("link", ""),
                origin=read_origin(joint),
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
    return Visual(shape.tag, size, shape.get("filename", ""), read_origin(visual), rgba)


def read_origin(element: ET.Element) -> Origin:
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
