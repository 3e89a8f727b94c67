"""Gaps and contacts between a robot and people or obstacles, for many ticks at once."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.arrays import to_rectangle
from mecazen.config.world import Box, Cylinder
from mecazen.geometry import Pose2D
from mecazen.robot import Robot
from mecazen.skeleton import INDEX, LIMBS
from mecazen_tools.observe import PersonOverTime
from mecazen_tools.table import Bools, Floats, Poses

CAUSED_M_S = 0.05
"""Speed of the robot towards a person above which a contact that begins is caused by the robot."""
_BEGINS = [INDEX[limb.begin] for limb in LIMBS]
_ENDS = [INDEX[limb.end] for limb in LIMBS]
_RADII = np.array([limb.radius for limb in LIMBS])


class Contacts(NamedTuple):
    """The contacts of a robot with a person in a run."""

    gap_m: Floats
    """Distance from the robot to the person (n) [m]; 0 or negative in contact."""
    rows: npt.NDArray[np.int64]
    """The sample before each contact (k)."""
    caused: Bools
    """Whether the robot caused each contact (k): it drove at the person, see `drives_at`."""


def contacts(robot: Robot, poses: Poses, person: PersonOverTime, step_s: float) -> Contacts:
    """Return the contacts of a robot at n poses with a person at the same times."""
    gap = gap_to_person(robot, poses, person)
    rows = onsets(gap)
    after = np.minimum(rows + 1, len(gap) - 1)
    before = PersonOverTime(person.joints[rows], person.height)
    moved = gap_to_person(robot, Poses(*(column[after] for column in poses)), before)
    return Contacts(gap, rows, drives_at(gap[rows], moved, step_s))


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
    return np.maximum(begins - 1, 0)


def to_outline(poses: Poses, half: tuple[float, float], points: Floats) -> Floats:
    """Return the distances of points (n, k, 2) from a rectangle at poses (n): 0 within it."""
    x, y = np.moveaxis(_seen(poses, points), -1, 0)
    return np.maximum(to_rectangle(x, y, half), 0.0)


def gap_to_person(robot: Robot, poses: Poses, person: PersonOverTime) -> Floats:
    """Return the distance from a robot's footprint to a person's limbs (n) [m].

    The distance is that of a rectangle and capsules seen from above; only the parts of limbs below
    the robot's top count. If they overlap, the distance is negative, down to minus the radius of a
    limb. It is NaN while there is no person.
    """
    begins, ends = person.joints[:, _BEGINS], person.joints[:, _ENDS]
    radii, along = _RADII * person.height, ends - begins
    top = robot.height + radii
    # from share `low` to share `high` of its length, a limb is not above the robot
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        cut = np.clip((top - begins[..., 2]) / along[..., 2], 0.0, 1.0)
    low = np.where(along[..., 2] < 0.0, cut, 0.0)[..., None]
    high = np.where(along[..., 2] > 0.0, cut, 1.0)[..., None]
    first, last = (_seen(poses, (begins + share * along)[..., :2]) for share in (low, high))
    gaps = _to_segments(robot.footprint, first, last) - radii
    gaps[np.minimum(begins[..., 2], ends[..., 2]) > top] = math.inf
    nearest: Floats = gaps.min(axis=1)
    return nearest


def gap_to_obstacle(robot: Robot, poses: Poses, solid: Box | Cylinder) -> Floats:
    """Return the distance from a robot's footprint to an obstacle (n) [m]; 0 if they touch.

    For a cylinder the distance is negative if they overlap.
    """
    n, half = len(poses.x), robot.footprint
    if isinstance(solid, Cylinder):
        centre = np.broadcast_to(solid.position_m, (n, 1, 2))
        return to_outline(poses, half, centre)[:, 0] - solid.size_m[0]
    box = Poses(*np.full((n, 3), (*solid.position_m, math.radians(solid.yaw_deg))).T)
    half_box = solid.size_m[0] / 2.0, solid.size_m[1] / 2.0
    # the shortest line between two rectangles starts at a corner of one of them
    to_robot = to_outline(poses, half, _corners(box, half_box))
    to_box = to_outline(box, half_box, _corners(poses, half))
    nearest: Floats = np.concatenate((to_robot, to_box), axis=1).min(axis=1)
    return nearest


def _seen(poses: Poses, points: Floats) -> Floats:
    """Transform points (n, k, 2) to the frames of poses (n)."""
    c, s = np.cos(poses.yaw)[:, None], np.sin(poses.yaw)[:, None]
    dx, dy = points[..., 0] - poses.x[:, None], points[..., 1] - poses.y[:, None]
    return np.stack((c * dx + s * dy, c * dy - s * dx), axis=-1)


def _corners(poses: Poses, half: tuple[float, float]) -> Floats:
    """Return the corners (n, 4, 2) of rectangles at poses (n)."""
    corners = [
        poses.compose(Pose2D(x, y)) for x in (half[0], -half[0]) for y in (half[1], -half[1])
    ]
    return np.stack([np.stack(corner[:2], axis=-1) for corner in corners], axis=1)


def _to_segments(half: tuple[float, float], first: Floats, last: Floats) -> Floats:
    """Return the distances of segments (n, k, 2) from a rectangle at the origin: 0 within it.

    The nearest point of a segment is an end of it, or the foot of the perpendicular from a corner,
    or it is where the line crosses a side of the rectangle.
    """
    along = last - first
    corners = np.array([(x, y) for x in (half[0], -half[0]) for y in (half[1], -half[1])])
    with np.errstate(divide="ignore", invalid="ignore"):
        feet = np.sum((corners - first[..., None, :]) * along[..., None, :], axis=-1)
        feet /= np.sum(along**2, axis=-1)[..., None]
        sides = np.stack((np.array(half), -np.array(half)))
        crossings = (sides - first[..., None, :]) / along[..., None, :]
    ends = np.broadcast_to((0.0, 1.0), (*first.shape[:-1], 2))
    crossings = crossings.reshape(*first.shape[:-1], 4)
    shares = np.nan_to_num(np.concatenate((ends, feet, crossings), axis=-1), posinf=1.0, neginf=0.0)
    points = first[..., None, :] + np.clip(shares, 0.0, 1.0)[..., None] * along[..., None, :]
    nearest: Floats = np.maximum(to_rectangle(points[..., 0], points[..., 1], half), 0.0).min(-1)
    return nearest
