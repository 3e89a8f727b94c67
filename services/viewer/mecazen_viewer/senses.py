"""Entities of the scene for sensor data, and for the body that the sensors observe."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import rerun as rr
from mecazen import messages as m
from mecazen.config.sensors import TrackerConfig
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D
from mecazen.limits import FARTHEST_M
from mecazen.robot import CameraMount
from mecazen.skeleton import INDEX, JOINTS, LIMBS, PARENTS

from mecazen_viewer import components
from mecazen_viewer import entities as e
from mecazen_viewer.entities import Entity
from mecazen_viewer.things import Array

BONE_RADIUS = rr.Radius.ui_points(1.2)
BEAM_RADIUS = rr.Radius.ui_points(1.6)
FRUSTUM_M = 0.6
"""Depth to which a camera's field of view is drawn."""
CLOTHES, TROUSERS, SKIN = (112, 128, 150), (70, 78, 92), (226, 180, 160)
_LOOKS = {"trunk": CLOTHES, "arm": CLOTHES, "head": SKIN, "thigh": TROUSERS, "shank": TROUSERS}
_BONES = [(INDEX[parent], INDEX[joint]) for joint, parent in PARENTS.items() if parent is not None]
_ENDS = [(INDEX[limb.begin], INDEX[limb.end]) for limb in LIMBS]
_TRUNK = next(number for number, limb in enumerate(LIMBS) if limb.name == "trunk")
_DRAWN_TRUNK = 0.7
"""Share of the trunk's line that is drawn, so that its round end reaches the shoulders."""
_FOR_LOOKS = (
    (INDEX["neck"], INDEX["head"], 0.033, SKIN),
    (INDEX["left_shoulder"], INDEX["right_shoulder"], 0.032, CLOTHES),
)
"""Neck and shoulders: ends, radius as a share of the body's height, and colour."""


def styles(height: float) -> Iterator[Entity]:
    """Return the static styles of a body of `height` [m], of detected bones and of a scan."""
    colours = [
        next((look for part, look in _LOOKS.items() if limb.name.endswith(part)), CLOTHES)
        for limb in LIMBS
    ]
    radii = [limb.radius * height for limb in LIMBS]
    for _, _, radius, colour in _FOR_LOOKS:
        colours.append(colour)
        radii.append(radius * height)
    yield e.BODY, rr.LineStrips3D.from_fields(colors=colours, radii=radii)
    yield e.SKELETON, rr.LineStrips3D.from_fields(colors=[e.ORANGE], radii=BONE_RADIUS)
    yield e.SCAN, rr.Points3D.from_fields(colors=[e.SKY], radii=BEAM_RADIUS)


def frustum(camera: CameraMount, tracker: TrackerConfig) -> Entity:
    """Return a camera's field of view, in base_link."""
    ahead, left, up = np.array(camera.axes)
    wide = math.tan(math.radians(tracker.horizontal_fov_deg) / 2)
    high = math.tan(math.radians(tracker.vertical_fov_deg) / 2)
    apex = np.array(camera.position_m)
    corners = [
        apex + FRUSTUM_M * (ahead + i * wide * left + j * high * up)
        for i, j in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    strips: list[Any] = [[*corners, corners[0]], *([apex, corner] for corner in corners)]
    view = rr.LineStrips3D(strips, colors=[e.GREY], radii=rr.Radius.ui_points(0.7))
    return e.FRUSTUM, view


def body(skeleton: m.Skeleton) -> Entity:
    """Return the true body, in world."""
    return limbs(_joints(skeleton))


def limbs(joints: Array) -> Entity:
    """Return a thick line for each limb of a body with these joints (20, 3) [m].

    The trunk of `LIMBS` is round up to the chin and hides the neck, so it is drawn shorter, and
    neck and shoulders are drawn as well.
    """
    strips = [joints[[begin, end]] for begin, end in _ENDS]
    strips = [
        _sphere(strip) if limb.begin == limb.end else strip
        for strip, limb in zip(strips, LIMBS, strict=True)
    ]
    pelvis, neck = strips[_TRUNK]
    strips[_TRUNK] = np.array((pelvis, pelvis + _DRAWN_TRUNK * (neck - pelvis)))
    strips += [joints[[begin, end]] for begin, end, _, _ in _FOR_LOOKS]
    return e.BODY, components.lines(strips)


def skeletons(seen: Sequence[m.Skeleton], robot: Pose2D) -> Entity:
    """Return the bones of all detected skeletons between joints in view, in world."""
    strips: list[Array] = []
    for one in seen:
        joints = _placed(_joints(one), robot)
        known = one.confidence or (2,) * len(JOINTS)
        strips += [joints[[a, b]] for a, b in _BONES if known[a] and known[b]]
    return e.SKELETON, components.lines(strips)


def people(persons: Sequence[m.Person]) -> Entity:
    """Return people's true bones in world; a person without joints is a line of their height."""
    strips: list[Array] = []
    for one in persons:
        if one.joints:
            joints = _joints(one)
            strips += [joints[[a, b]] for a, b in _BONES]
        else:
            place = one.pose.position
            if max(abs(place.x), abs(place.y), one.height) > FARTHEST_M:
                raise RefusedError(f"pose out of range: {one.pose}")
            strips.append(np.array([(place.x, place.y, 0.0), (place.x, place.y, one.height)]))
    return e.PEOPLE, components.lines(strips)


def scan(message: m.LaserScan, lidar: Sequence[float], robot: Pose2D) -> Entity:
    """Return the points of a scan in world; the lidar is at (3,) [m] in base_link."""
    ranges = np.array(message.ranges)
    (valid,) = np.nonzero((ranges >= message.range_min) & (ranges <= message.range_max))
    angles = message.angle_min + message.angle_increment * valid
    along = ranges[valid]
    places = np.stack(
        (along * np.cos(angles), along * np.sin(angles), np.zeros(len(valid))), axis=-1
    )
    return e.SCAN, components.points(_placed(places + np.array(lidar), robot))


def depth(image: m.Image) -> Entity:
    """Return a depth picture.

    Raises:
        RefusedError: The image does not have 16 bits, or its data has a wrong size.
    """
    if image.encoding != "16UC1" or len(image.data) != 2 * image.width * image.height:
        raise RefusedError(f"depth picture: {image.encoding!r}, {len(image.data)} bytes")
    pixels = np.frombuffer(image.data, "<u2").reshape(image.height, image.width)
    return e.DEPTH, rr.DepthImage(pixels, meter=1000.0)


def _joints(skeleton: m.Skeleton | m.Person) -> Array:
    if len(skeleton.joints) != len(JOINTS):
        raise RefusedError(f"a skeleton has {len(JOINTS)} joints, not {len(skeleton.joints)}")
    joints: Array = np.array([(joint.x, joint.y, joint.z) for joint in skeleton.joints])
    if np.abs(joints).max() > FARTHEST_M:
        raise RefusedError("joints out of range")
    return joints


def _sphere(strip: Array) -> Array:
    """Return a line so short that it looks like a sphere with its round ends, from all sides."""
    return np.add(strip, ((-0.01, -0.01, -0.01), (0.01, 0.01, 0.01)))


def _placed(points: Array, robot: Pose2D) -> Array:
    """Return points (N, 3) in base_link as points in world."""
    c, s = math.cos(robot.yaw), math.sin(robot.yaw)
    turn = np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)))
    placed: Array = points @ turn + (robot.x, robot.y, 0.0)
    return placed
