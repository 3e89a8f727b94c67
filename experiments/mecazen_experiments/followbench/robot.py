"""The robot of Follow-Bench: a unicycle about its rear axle, its lidar, and whom it sees.

A map of known cells around the robot determines visibility. A scan redraws only the part of the map
that its beams span, so parts of older scans remain; this module reproduces that behaviour.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.arrays import between, to_rectangle
from mecazen.geometry import Pose2D, overlap, wrap
from mecazen.portable import Floats
from scipy.ndimage import label

from mecazen_experiments.followbench.episodes import STEP_S

MAX_V, MAX_W = 2.0, math.pi
"""Maximum speed [m/s] and yaw rate [rad/s], forwards and backwards."""
ACCELERATION_V, ACCELERATION_W, BRAKING = 2.0, math.pi, 50.0
"""Maximum acceleration away from rest [m/s²], [rad/s²], and ratio of deceleration to it."""
CENTRE, HALF = 0.25, (0.35, 0.275)
"""Centre of the outline ahead of the axle, and half its length and width [m]: 0.70 x 0.55."""
PERSON_RADIUS = 0.3
"""Radius of the disc of a person [m]."""
EDGE_M = 0.2
"""Width of the strip around the map in which the robot can still move."""
BEAMS, RANGE = 200, 5.0
"""Beams over 360°, and their length [m]."""
APART = 2.0 * math.pi / (BEAMS - 1)
"""Angle between two beams [rad]: the first and the last beam point backwards."""
ANGLES: Floats = np.arange(BEAMS, dtype=np.float64) * APART - math.pi
"""Angle of each beam from the robot's heading [rad], counter-clockwise."""
DIRECTIONS: Floats = np.stack((np.cos(ANGLES), np.sin(ANGLES)))
PER_M, HALF_M, MARGIN = 10, 6, 1.0
"""Map of known cells: cells per metre, half of its side, and the margin around the ends of the
beams in which a scan redraws it [m]."""

Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]


class Unicycle(NamedTuple):
    """State: pose of the rear axle in the world, speed v [m/s], yaw rate w [rad/s]."""

    pose: Pose2D
    v: float = 0.0
    w: float = 0.0

    def step(self, v: float, w: float, size: tuple[float, float]) -> Unicycle:
        """Return the state after a step on a map of `size` (width, height) [m].

        As in Euler's method, the robot moves along the heading before the step. A step that would
        leave the map by a cell stops the robot.
        """
        dt = STEP_S
        v = _limit(v, self.v, MAX_V, ACCELERATION_V * dt)
        w = _limit(w, self.w, MAX_W, ACCELERATION_W * dt)
        x = self.pose.x + v * math.cos(self.pose.yaw) * dt
        y = self.pose.y + v * math.sin(self.pose.yaw) * dt
        if not all(-EDGE_M < at < length + EDGE_M for at, length in zip((x, y), size, strict=True)):
            return Unicycle(self.pose)
        return Unicycle(Pose2D(x, y, wrap(self.pose.yaw + w * dt)), v, w)


def touches(pose: Pose2D, discs: Floats, boxes: Floats) -> bool:
    """Return whether the outline at a pose touches a person or a box.

    Args:
        pose: Pose of the rear axle in the world.
        discs: Centres (n, 2) of people [m].
        boxes: Centre x, y [m], yaw [rad], length and width [m] of each box (n, 5).
    """
    centre = pose.compose(Pose2D(CENTRE))
    return bool(np.any(gaps(pose, discs) <= 0.0)) or any(
        overlap(centre, HALF, Pose2D(x, y, yaw), (length / 2.0, width / 2.0))
        for x, y, yaw, length, width in boxes.tolist()
    )


def gaps(pose: Pose2D, discs: Floats) -> Floats:
    """Return the distances (n) [m] between the outline at a pose and people at (n, 2)."""
    ahead, beside = between(pose, discs).T
    distances: Floats = to_rectangle(ahead - CENTRE, beside, HALF) - PERSON_RADIUS
    return distances


def _limit(command: float, value: float, most: float, gain: float) -> float:
    """Return the value nearest to a command that the limits of a step allow.

    While the robot moves, the value changes by at most `gain` away from zero, and by 50 times that
    towards and beyond zero. From rest any value is allowed at once.
    """
    low = value - (BRAKING if value > 0.0 else 1.0) * gain if value else -most
    high = value + (BRAKING if value < 0.0 else 1.0) * gain if value else most
    return min(max(command, low, -most), high, most)


def scan(pose: Pose2D, discs: Floats, boxes: Floats) -> Floats:
    """Return the length (200) [m] of each beam from a pose; 5 m if a beam hits nothing.

    Args:
        pose: Pose of the lidar in the world.
        discs: Centres (n, 2) of people [m].
        boxes: Centre x, y [m], yaw [rad], length and width [m] of each box (n, 5).
    """
    return np.minimum(RANGE, np.minimum(_to_discs(between(pose, discs)), _to_boxes(pose, boxes)))


def _to_discs(centres: Floats) -> Floats:
    """Return the distance (200) [m] along each beam to the nearest disc; ∞ if there is none."""
    c, s = DIRECTIONS[:, :, None]
    along = c * centres[:, 0] + s * centres[:, 1]
    across = c * centres[:, 1] - s * centres[:, 0]
    square = PERSON_RADIUS**2 - across * across
    half = np.sqrt(np.maximum(square, 0.0))
    hits = (square >= 0.0) & (along + half >= 0.0)
    distances = np.where(hits, np.maximum(along - half, 0.0), np.inf)
    return np.asarray(distances.min(axis=1, initial=np.inf))


def _to_boxes(pose: Pose2D, boxes: Floats) -> Floats:
    """Return the distance (200) [m] along each beam to the nearest box; ∞ if there is none.

    The method is the slab method, T. Kay and J. Kajiya, SIGGRAPH 1986, in the frame of each box.
    """
    x, y, yaw, length, width = boxes.T
    dx, dy = pose.x - x, pose.y - y
    c, s = np.cos(yaw), np.sin(yaw)
    angles = ANGLES[:, None] + (pose.yaw - yaw)
    enter, leave = np.zeros_like(angles), np.full_like(angles, np.inf)
    for start, half, cosine in (
        (c * dx + s * dy, length / 2.0, np.cos(angles)),
        (c * dy - s * dx, width / 2.0, np.sin(angles)),
    ):
        slope = np.where(np.abs(cosine) < 1e-12, 1e-12, cosine)  # parallel to the slab
        near, far = (-half - start) / slope, (half - start) / slope
        enter = np.maximum(enter, np.minimum(near, far))
        leave = np.minimum(leave, np.maximum(near, far))
    distances = np.where(enter <= leave, enter, np.inf)
    return np.asarray(distances.min(axis=1, initial=np.inf))


class KnownArea:
    """The known cells around the robot, in the robot's frame: x by column, y by row.

    At first, all cells within 5 m are known. Each scan redraws the part of the map that spans the
    ends of its beams; cells outside of that part do not change.
    """

    def __init__(self) -> None:
        side = 2 * HALF_M * PER_M
        self.cells: Bools = np.zeros((side, side), bool)
        self.update(np.full(BEAMS, RANGE))

    def update(self, ranges: Floats) -> None:
        """Redraw the area within the ends of beams (200) [m]."""
        x, y = ranges * DIRECTIONS
        left, right = round(x.min() - MARGIN), round(x.max() + MARGIN)
        low, high = round(y.min() - MARGIN), round(y.max() + MARGIN)
        column = np.floor((x - left) * PER_M).astype(np.int64)
        row = np.floor((y - low) * PER_M).astype(np.int64)
        drawn = np.zeros(((high - low) * PER_M, (right - left) * PER_M), bool)
        rows, columns = _outline(row, column)
        drawn[rows, columns] = True
        areas, _ = label(~drawn)
        around = ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0))
        inside = [areas[dr - low * PER_M, dc - left * PER_M] for dr, dc in around]
        for area in {int(number) for number in inside} - {0}:
            drawn |= areas == area
        for dr, dc in ((0, 1), (1, 0), (1, 1)):  # the end of a beam is two cells thick
            drawn[row + dr, column + dc] = True
        top, start = (low + HALF_M) * PER_M, (left + HALF_M) * PER_M
        self.cells[top : top + len(drawn), start : start + drawn.shape[1]] = drawn

    def sees(self, pose: Pose2D, people: Floats) -> Bools:
        """Return which of the people at (n, 2) are visible from a pose (n).

        A person is visible within 5.3 m if any cell of the square around their disc is known.
        """
        relative = between(pose, people)
        low = np.rint((relative - PERSON_RADIUS) * PER_M + HALF_M * PER_M).astype(np.int64)
        high = np.rint((relative + PERSON_RADIUS) * PER_M + HALF_M * PER_M).astype(np.int64)
        side = len(self.cells)
        near = np.hypot(*relative.T) - PERSON_RADIUS <= RANGE
        near &= np.all((low >= 0) & (high < side), axis=1)
        return np.array(
            [
                is_near and bool(self.cells[bottom:top, left:right].any())
                for is_near, (left, bottom), (right, top) in zip(near, low, high, strict=True)
            ]
        )


def _outline(row: Ints, column: Ints) -> tuple[Ints, Ints]:
    """Return the cells of the closed polygon through the given cells.

    J. E. Bresenham, Algorithm for computer control of a digital plotter, IBM Systems Journal
    4, 1965; every line is drawn from its smaller to its larger main coordinate.
    """
    ends = np.stack((row, column))
    nexts = np.roll(ends, -1, axis=1)
    is_steep = np.abs(nexts[0] - ends[0]) > np.abs(nexts[1] - ends[1])
    main, minor = np.where(is_steep, ends, ends[::-1])
    main_end, minor_end = np.where(is_steep, nexts, nexts[::-1])
    swap = main > main_end
    main, main_end = np.where(swap, main_end, main), np.where(swap, main, main_end)
    minor, minor_end = np.where(swap, minor_end, minor), np.where(swap, minor, minor_end)
    length, height = main_end - main, minor_end - minor
    which = np.repeat(np.arange(len(main)), length + 1)
    step = np.arange(len(which)) - np.repeat(np.cumsum(length + 1) - length - 1, length + 1)
    over = step * np.abs(height[which]) - length[which] // 2
    rise = -(-over // np.maximum(length[which], 1))  # rounded up
    along, beside = main[which] + step, minor[which] + np.sign(height[which]) * rise
    steep = is_steep[which]
    return np.where(steep, along, beside), np.where(steep, beside, along)
