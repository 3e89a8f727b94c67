"""The lidar of Follow-Bench, and which people its robot sees.

A map of known cells about the robot decides what is visible. A scan draws only the part of the map
that its beams span, so parts of older scans remain: this module reproduces that.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from mecazen.geometry import Pose2D
from mecazen.geometry_batch import between
from mecazen.portable import Floats
from scipy.ndimage import label

from mecazen_experiments.followbench.unicycle import PERSON_RADIUS

BEAMS, RANGE = 200, 5.0
"""Beams over 360°, and their length [m]."""
APART = 2.0 * math.pi / (BEAMS - 1)
"""Angle between two beams [rad]: the first and the last one point backwards."""
ANGLES: Floats = np.arange(BEAMS, dtype=np.float64) * APART - math.pi
"""Angle of each beam to the robot's heading [rad], counter-clockwise."""
DIRECTIONS: Floats = np.stack((np.cos(ANGLES), np.sin(ANGLES)))
PER_M = 10
"""Cells per metre of the map of what is known."""
HALF_M = 6
"""Half the side of that map [m]."""
MARGIN = 1.0
"""Part of the map about the ends of the beams that a scan draws again [m]."""

Ints = npt.NDArray[np.int64]
Bools = npt.NDArray[np.bool_]


def scan(pose: Pose2D, discs: Floats, boxes: Floats) -> Floats:
    """Return the length (200) [m] of each beam from a pose, 5 m where it meets nothing.

    Args:
        pose: The lidar in the world.
        discs: Centres (n, 2) of people [m].
        boxes: Centre x, y [m], yaw [rad], length and width [m] of each box (n, 5).
    """
    ranges = np.full(BEAMS, RANGE)
    centres = between(pose, discs)
    near = np.hypot(*centres.T) < RANGE + PERSON_RADIUS
    if np.any(near):
        ranges = np.minimum(ranges, _to_discs(centres[near]))
    reach = RANGE + np.hypot(boxes[:, 3], boxes[:, 4]) / 2.0
    near = np.hypot(boxes[:, 0] - pose.x, boxes[:, 1] - pose.y) < reach
    if np.any(near):
        ranges = np.minimum(ranges, _to_boxes(pose, boxes[near]))
    return ranges


def _to_discs(centres: Floats) -> Floats:
    """Return the distance (200) [m] along each beam to the nearest disc, ∞ where none is."""
    c, s = DIRECTIONS[:, :, None]
    along = c * centres[:, 0] + s * centres[:, 1]
    across = c * centres[:, 1] - s * centres[:, 0]
    square = PERSON_RADIUS**2 - across * across
    enter = along - np.sqrt(np.maximum(square, 0.0))
    leave = along + np.sqrt(np.maximum(square, 0.0))
    hits = (square >= 0.0) & (leave >= 0.0)
    nearest: Floats = np.where(hits, np.maximum(enter, 0.0), np.inf).min(axis=1)
    return nearest


def _to_boxes(pose: Pose2D, boxes: Floats) -> Floats:
    """Return the distance (200) [m] along each beam to the nearest box, ∞ where none is.

    The slab method, T. Kay and J. Kajiya, SIGGRAPH 1986, in the frame of each box.
    """
    yaw = boxes[:, 2]
    dx, dy = pose.x - boxes[:, 0], pose.y - boxes[:, 1]
    c, s = np.cos(yaw), np.sin(yaw)
    starts = (c * dx + s * dy, c * dy - s * dx)
    angles = ANGLES[:, None] + (pose.yaw - yaw)
    slopes = (np.cos(angles), np.sin(angles))
    halves = (boxes[:, 3] / 2.0, boxes[:, 4] / 2.0)
    enter, leave = np.zeros_like(angles), np.full_like(angles, np.inf)
    for start, half, cosine in zip(starts, halves, slopes, strict=True):
        slope = np.where(np.abs(cosine) < 1e-12, 1e-12, cosine)  # parallel to the slab
        one, other = (-half - start) / slope, (half - start) / slope
        enter = np.maximum(enter, np.minimum(one, other))
        leave = np.minimum(leave, np.maximum(one, other))
    nearest: Floats = np.where(enter <= leave, enter, np.inf).min(axis=1)
    return nearest


class KnownArea:
    """The cells about the robot that are known, in its frame: x by column, y by row.

    At first, all within 5 m is known. Each scan draws the part of the map about its ends again;
    cells outside of it do not change.
    """

    def __init__(self) -> None:
        side = 2 * HALF_M * PER_M
        self.cells: Bools = np.zeros((side, side), bool)
        self._sums: Ints = np.zeros((side + 1, side + 1), np.int64)
        self.update(np.full(BEAMS, RANGE))

    def update(self, ranges: Floats) -> None:
        """Draw the area within the ends of beams (200) [m]."""
        x, y = ranges * DIRECTIONS
        left, right = round(x.min() - MARGIN), round(x.max() + MARGIN)
        low, high = round(y.min() - MARGIN), round(y.max() + MARGIN)
        column = np.floor((x - left) * PER_M).astype(np.int64)
        row = np.floor((y - low) * PER_M).astype(np.int64)
        drawn = np.zeros(((high - low) * PER_M, (right - left) * PER_M), bool)
        rows, columns = _outline(row, column)
        drawn[rows, columns] = True
        areas, _ = label(~drawn)
        centre_row, centre_column = -low * PER_M, -left * PER_M
        inside = [
            areas[centre_row + dr, centre_column + dc]
            for dr, dc in ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0))
        ]
        for area in {int(number) for number in inside} - {0}:
            drawn |= areas == area
        for dr, dc in ((0, 1), (1, 0), (1, 1)):  # an end is two cells thick
            drawn[row + dr, column + dc] = True
        top, start = (low + HALF_M) * PER_M, (left + HALF_M) * PER_M
        self.cells[top : top + len(drawn), start : start + drawn.shape[1]] = drawn
        self._sums[1:, 1:] = self.cells.cumsum(axis=0, dtype=np.int64).cumsum(axis=1)

    def sees(self, pose: Pose2D, people: Floats) -> Bools:
        """Return who (n) of the people at (n, 2) is seen from a pose.

        A person is seen within 5.3 m if any cell of the square about their disc is known.
        """
        at = between(pose, people)
        low = np.rint((at - PERSON_RADIUS) * PER_M + HALF_M * PER_M).astype(np.int64)
        high = np.rint((at + PERSON_RADIUS) * PER_M + HALF_M * PER_M).astype(np.int64)
        side = len(self.cells)
        near = np.hypot(*at.T) - PERSON_RADIUS <= RANGE
        near &= np.all((low >= 0) & (high < side), axis=1)
        (left, bottom), (right, top) = np.clip(low, 0, side).T, np.clip(high, 0, side).T
        sums = self._sums
        known = sums[top, right] - sums[bottom, right] - sums[top, left] + sums[bottom, left]
        seen: Bools = near & (known > 0)
        return seen


def _outline(row: Ints, column: Ints) -> tuple[Ints, Ints]:
    """Return the cells of the closed polygon through given ones.

    J. E. Bresenham, Algorithm for computer control of a digital plotter, IBM Systems Journal
    4, 1965; every line is drawn from its smaller to its larger main coordinate.
    """
    ends = np.stack((row, column))
    others = np.roll(ends, -1, axis=1)
    is_steep = np.abs(others[0] - ends[0]) > np.abs(others[1] - ends[1])
    main, minor = np.where(is_steep, ends, ends[::-1])
    main_end, minor_end = np.where(is_steep, others, others[::-1])
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
