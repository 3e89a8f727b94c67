"""Bodies of people, and what the robot's sensors see of the scene."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import rerun as rr
from mecazen import messages as m
from mecazen.arrays import rotate
from mecazen.config.sensors import TrackerConfig
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D
from mecazen.portable import Floats
from mecazen.robot import CameraMount
from mecazen.skeleton import INDEX, JOINTS, LIMBS, PARENTS

from mecazen_viewer import layout
from mecazen_viewer.layout import Colour, Entity

BONE_RADIUS = rr.Radius.ui_points(1.2)
BEAM_RADIUS = rr.Radius.ui_points(1.6)
FRUSTUM_M = 0.6
"""Depth to which a camera's field of view is drawn."""
Look = tuple[Colour, Colour, Colour]
"""Colours of clothes, trousers and skin."""
FOLLOWED: Look = (63, 111, 159), (47, 66, 88), (230, 184, 156)
OTHER: Look = (179, 187, 197), (152, 162, 174), (211, 199, 191)
"""Those of a person whom a robot follows, and of other people."""
CLOTHES, TROUSERS, SKIN = range(3)
LOOKS = {"forearm": SKIN, "head": SKIN, "thigh": TROUSERS, "shank": TROUSERS, "foot": TROUSERS}
"""The cover of a limb, by the end of its name; clothes cover other limbs."""
DRAWN_TRUNK = 0.7
"""Share of the trunk's line that is drawn, so that its round end reaches the shoulders."""
DRAWN = [
    (limb.begin, limb.end, limb.radius, LOOKS.get(limb.name.rpartition("_")[2], CLOTHES))
    for limb in LIMBS
]
DRAWN += [("neck", "head", 0.033, SKIN), ("left_shoulder", "right_shoulder", 0.032, CLOTHES)]
"""Ends, radius as a share of the body's height, and cover."""
_BONES = np.array([(INDEX[start], INDEX[joint]) for joint, start in PARENTS.items() if start])
_LIMBS = np.array([(INDEX[begin], INDEX[end]) for begin, end, _, _ in DRAWN])
_RADII = np.array([radius for _, _, radius, _ in DRAWN])
_TRUNK = next(number for number, limb in enumerate(LIMBS) if limb.name == "trunk")
_ROUND = _LIMBS[:, 0] == _LIMBS[:, 1]


def styles() -> Iterator[Entity]:
    """Return the static styles of detected bones and of a scan."""
    bones = rr.LineStrips3D.from_fields(colors=[layout.ORANGE], radii=BONE_RADIUS)
    yield layout.SKELETON, bones
    yield layout.SCAN, rr.Points3D.from_fields(colors=[layout.BLUE], radii=BEAM_RADIUS)


def frustum(camera: CameraMount, tracker: TrackerConfig) -> rr.LineStrips3D:
    """Return a camera's field of view, in base_link."""
    ahead, left, up = np.array(camera.axes)
    half_width = math.tan(math.radians(tracker.horizontal_fov_deg) / 2)
    half_height = math.tan(math.radians(tracker.vertical_fov_deg) / 2)
    apex = np.array(camera.position_m)
    corners = [
        apex + FRUSTUM_M * (ahead + i * half_width * left + j * half_height * up)
        for i, j in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    strips: list[Any] = [[*corners, corners[0]], *([apex, corner] for corner in corners)]
    return rr.LineStrips3D(strips, colors=[layout.GREY], radii=rr.Radius.ui_points(0.7))


def bodies(joints: Floats, heights: Floats, look: Look) -> rr.LineStrips3D:
    """Return a thick line for each limb of n bodies with joints (n, 20, 3) in world [m].

    The trunk of `LIMBS` is round up to the chin and hides the neck, so it is drawn shorter, and
    neck and shoulders are drawn as well.
    """
    strips = joints[:, _LIMBS].astype(np.float32)
    # a line so short that it looks like a sphere with its round ends, from all sides
    strips[:, _ROUND] += np.array([[[-0.01], [0.01]]])
    pelvis, neck = strips[:, _TRUNK, 0], strips[:, _TRUNK, 1]
    strips[:, _TRUNK, 1] = pelvis + DRAWN_TRUNK * (neck - pelvis)
    colours = [look[cover] for _, _, _, cover in DRAWN] * len(joints)
    return rr.LineStrips3D(
        strips.reshape(-1, 2, 3), colors=colours, radii=np.outer(heights, _RADII).ravel()
    )


def skeletons(detections: Sequence[m.Skeleton], robot: Pose2D) -> rr.LineStrips3D:
    """Return the bones of all detected skeletons between joints in view, in world."""
    strips = [np.empty((0, 2, 3))]
    for skeleton in detections:
        joints = _to_world(joints_of(skeleton), robot)
        is_seen = np.array(skeleton.confidence or (2,) * len(JOINTS)) > 0
        if len(is_seen) != len(JOINTS):
            raise RefusedError(f"a confidence for {len(is_seen)} of {len(JOINTS)} joints")
        strips.append(joints[_BONES[is_seen[_BONES].all(axis=1)]])
    return rr.LineStrips3D(np.concatenate(strips))


def scan(message: m.LaserScan, lidar: Floats, robot: Pose2D) -> rr.Points3D:
    """Return the points of a scan in world; the lidar is at (3,) [m] in base_link."""
    ranges = np.array(message.ranges)
    (valid,) = np.nonzero((ranges >= message.range_min) & (ranges <= message.range_max))
    angles = message.angle_min + message.angle_increment * valid
    along = ranges[valid]
    points = np.column_stack((along * np.cos(angles), along * np.sin(angles), 0.0 * along))
    return rr.Points3D(_to_world(points + lidar, robot))


def depth(image: m.Image) -> rr.DepthImage:
    """Return a depth picture.

    Raises:
        RefusedError: The image does not have 16 bits, or its data has a wrong size.
    """
    if image.encoding != "16UC1" or len(image.data) != 2 * image.width * image.height:
        raise RefusedError(f"depth picture: {image.encoding!r}, {len(image.data)} bytes")
    pixels = np.frombuffer(image.data, "<u2").reshape(image.height, image.width)
    return rr.DepthImage(pixels, meter=1000.0)


def joints_of(skeleton: m.Skeleton | m.Person) -> Floats:
    """Return the joints (20, 3) [m].

    Raises:
        RefusedError: Their number is wrong.
    """
    if len(skeleton.joints) != len(JOINTS):
        raise RefusedError(f"a skeleton has {len(JOINTS)} joints, not {len(skeleton.joints)}")
    return np.array([(joint.x, joint.y, joint.z) for joint in skeleton.joints])


def _to_world(points: Floats, robot: Pose2D) -> Floats:
    """Return points (N, 3) in base_link as points in world."""
    placed: Floats = rotate(points, robot.yaw) + np.array((robot.x, robot.y, 0.0))
    return placed
