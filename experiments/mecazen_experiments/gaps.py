"""Gaps between a robot and people or obstacles, for many ticks at once."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from mecazen.arrays import to_rectangle
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D
from mecazen.robot import Robot
from mecazen.skeleton import INDEX, LIMBS
from mecazen_tools.table import Bools, Floats, Poses

CAUSED_M_S = 0.05
"""Speed of the robot towards a person above which a contact that begins is caused by the robot."""
_STEPS = 40
"""Steps of the search for the nearest point of a segment, to a precision of 1e-7 of its length."""
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_BEGINS = [INDEX[limb.begin] for limb in LIMBS]
_ENDS = [INDEX[limb.end] for limb in LIMBS]
_RADII = np.array([limb.radius for limb in LIMBS])


def drives_at(before: Floats, after: Floats, step_s: float) -> Bools:
    """Return whether a robot drives at a person in a step: the only definition of its part.

    Args:
        before: Gaps before the step [m].
        after: Gaps to the same place of the person after the robot's move [m].
        step_s: Duration of the step [s].
    """
    with np.errstate(invalid="ignore"):
        return (before - after) / step_s > CAUSED_M_S


def onsets(gap: Floats) -> npt.NDArray[np.int64]:
    """Return the begins of contacts: the sample before the first sample of each contact."""
    touching = gap <= 0.0
    begins = np.flatnonzero(touching & ~np.concatenate(([False], touching[:-1])))
    onsets: npt.NDArray[np.int64] = np.maximum(begins - 1, 0)
    return onsets


def height_of(robot: Robot) -> float:
    """Return the height of a robot's highest part [m]."""
    camera, lidar, load = robot.camera, robot.lidar, robot.payload
    parts = [
        robot.base.clearance_m + robot.base.height_m,
        2.0 * robot.wheels.radius_m,
        camera.position_m[2] + camera.size_m[2] / 2.0,
        lidar.position_m[2] + lidar.size_m[1] / 2.0,
    ]
    if load is not None:
        parts.append(load.position_m[2] + load.size_m[2] / 2.0)
    return max(parts)


def to_outline(poses: Poses, half: tuple[float, float], points: Floats) -> Floats:
    """Return the distances of points (n, k, 2) from a rectangle at poses (n): 0 within it."""
    c, s = np.cos(poses.yaw)[:, None], np.sin(poses.yaw)[:, None]
    dx, dy = points[..., 0] - poses.x[:, None], points[..., 1] - poses.y[:, None]
    return np.maximum(to_rectangle(c * dx + s * dy, c * dy - s * dx, half), 0.0)


def gap_to_person(robot: Robot, poses: Poses, joints: Floats, height: float) -> Floats:
    """Return the distance from a robot's footprint to a person's limbs (n) [m].

    The distance is that of a rectangle and capsules seen from above; only the parts of limbs below
    the robot's top count. If they overlap, the distance is negative, down to minus the radius of a
    limb.

    Args:
        robot: The robot.
        poses: The robot's n poses in the world.
        joints: The person's joints in the world (n, 20, 3) [m]; NaN if there is no person.
        height: Height of the person, of which limb radii are shares [m].
    """
    begins, ends = joints[:, _BEGINS], joints[:, _ENDS]
    radii, top = _RADII * height, height_of(robot)
    # from share `low` to share `high` of its length, a limb is not above the robot
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        cut = (top + radii - begins[..., 2]) / (ends[..., 2] - begins[..., 2])
    rises = ends[..., 2] > begins[..., 2]
    level = ends[..., 2] == begins[..., 2]
    low = np.where(rises | level, 0.0, np.clip(cut, 0.0, 1.0))
    high = np.where(rises & ~level, np.clip(cut, 0.0, 1.0), 1.0)
    above = np.minimum(begins[..., 2], ends[..., 2]) > top + radii
    half = robot.footprint

    def distance(share: Floats) -> Floats:
        points = begins[..., :2] + share[..., None] * (ends - begins)[..., :2]
        return to_outline(poses, half, points)

    found = _minimum(distance, low, high) - radii
    found[above] = math.inf
    nearest: Floats = found.min(axis=1)
    return nearest


def gap_to_obstacle(robot: Robot, poses: Poses, thing: Box | Cylinder) -> Floats:
    """Return the distance from a robot's footprint to an obstacle (n) [m]; 0 if they touch.

    For a cylinder the distance is negative if they overlap.
    """
    x, y = thing.position_m
    half = robot.footprint
    if isinstance(thing, Cylinder):
        centre = np.broadcast_to((x, y), (len(poses.x), 1, 2))
        return to_outline(poses, half, centre)[:, 0] - thing.size_m[0]
    place = Pose2D(x, y, math.radians(thing.yaw_deg))
    of_box = thing.size_m[0] / 2.0, thing.size_m[1] / 2.0
    # the shortest line between two rectangles starts at a corner of one of them
    corners = [place.compose(Pose2D(*corner)) for corner in _corners(of_box)]
    of_robot = [poses.compose(Pose2D(*corner)) for corner in _corners(half)]
    at = Poses(*(np.full(len(poses.x), value) for value in place))
    theirs = np.broadcast_to([(one.x, one.y) for one in corners], (len(poses.x), 4, 2))
    ours = np.stack([np.stack((one.x, one.y), axis=-1) for one in of_robot], axis=1)
    both = np.concatenate((to_outline(poses, half, theirs), to_outline(at, of_box, ours)), axis=1)
    nearest: Floats = both.min(axis=1)
    return nearest


def _corners(half: tuple[float, float]) -> list[tuple[float, float]]:
    length, width = half
    return [(length, width), (-length, width), (-length, -width), (length, -width)]


def _minimum(function: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """Return the minimum of a convex function between `low` and `high`, by golden sections."""
    for _ in range(_STEPS):
        width = _GOLDEN * (high - low)
        left, right = high - width, low + width
        nearer = function(left) <= function(right)
        low, high = np.where(nearer, low, left), np.where(nearer, right, high)
    return function((low + high) / 2.0)
