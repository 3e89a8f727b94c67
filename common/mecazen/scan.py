"""Groups the points of a lidar's scan into things, and things that are legs into persons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt

from mecazen.messages import LaserScan
from mecazen.portable import Floats

Indices = npt.NDArray[np.intp]
Flags = npt.NDArray[np.bool_]

LEG_M = 0.25
"""Greatest width of a leg, with clothes."""
BOTH_LEGS_M = 0.5
"""Greatest width of two legs that stand together."""
STRIDE_M = 0.9
"""Greatest distance between the legs of one person."""


class Things:
    """The points of a scan, grouped by thing.

    Attributes:
        xy: Positions of the points (n, 2) [m].
        starts: Index of the first point of each of k things (k).
        counts: Number of points of each thing (k).
        index: Index of the thing of each point (n).
        middle: Mean of each thing's points (k, 2) [m].
        width: Twice the distance of the thing's farthest point from its middle (k) [m].
    """

    def __init__(self, xy: Floats, starts: Indices) -> None:
        self.xy, self.starts = xy, starts
        self.counts = np.diff(starts, append=len(xy))
        self.index = np.repeat(np.arange(len(starts)), self.counts)
        self.middle: Floats = np.zeros((0, 2))
        self.width: Floats = np.zeros(0)
        if len(xy):
            self.middle = np.add.reduceat(xy, starts) / self.counts[:, None]
            off = xy - self.middle[self.index]
            squares = off[:, 0] * off[:, 0] + off[:, 1] * off[:, 1]
            self.width = 2.0 * np.sqrt(np.maximum.reduceat(squares, starts))


def ranges_of(scan: LaserScan, *, is_real: bool = False) -> Floats:
    """Return the ranges of a scan [m] (n): inf without a return, NaN without a measurement.

    0 is no measurement if the scan shows by a range beyond range_max what no return looks like. If
    the scan of a real lidar does not, and something was measured, the driver sends 0 for no return,
    as that of YDLIDAR. An object below range_min has a range between 0 and range_min.
    """
    ranges: Floats = np.array(scan.ranges, dtype=float)
    beyond, unknown = ranges > scan.range_max, ~(ranges > 0.0)
    is_measured = bool(np.any((ranges >= scan.range_min) & ~beyond & ~unknown))
    is_return_known = not is_real or not is_measured or bool(beyond.any())
    ranges[unknown] = math.nan if is_return_known else math.inf
    ranges[beyond] = math.inf
    return ranges


def hits(scan: LaserScan, ranges: Floats, farthest_m: float = math.inf) -> tuple[Floats, Indices]:
    """Return the points hit up to a range (n, 2) [m], in the lidar's frame, and their beams (n)."""
    most = min(scan.range_max, farthest_m)
    (beams,) = np.nonzero((ranges >= scan.range_min) & (ranges <= most))
    angles = scan.angle_min + scan.angle_increment * beams
    return ranges[beams, None] * np.stack((np.cos(angles), np.sin(angles)), axis=-1), beams


def clusters(xy: Floats, beams: Indices, count: int, gap_m: float) -> tuple[Floats, Indices]:
    """Return the points grouped by thing, and the index at which each thing begins.

    The scan is a circle: a thing may begin with the last beams and end with the first.

    Args:
        xy: Points in the order of their beams (n, 2) [m].
        beams: Index of the beam of each point (n).
        count: Number of beams of the scan.
        gap_m: Neighbouring points that are farther apart belong to different things.
    """
    if not len(xy):
        return xy, beams
    steps = np.diff(xy, axis=0, append=xy[:1])
    (cuts,) = np.nonzero(steps[:, 0] ** 2 + steps[:, 1] ** 2 > gap_m**2)
    if not len(cuts):  # one thing: it begins after the widest gap between its beams
        cuts = np.argmax(np.diff(beams, append=beams[0] + count), keepdims=True)
    return np.roll(xy, -(cuts[0] + 1), axis=0), np.concatenate(([0], cuts[1:] - cuts[0]))


def by_person(places: Sequence[Sequence[float]], legs: Flags, both: Flags) -> list[list[int]]:
    """Group things by person: return the indices of each person's things, each thing once.

    Args:
        places: Middles of all things (k, 2) [m].
        legs: Whether a thing may be a leg (k); the two nearest to each other are one person's.
        both: Whether a thing may be two legs that stand together (k).
    """
    legs_left, persons = set(np.flatnonzero(legs).tolist()), []
    near = sorted(
        (distance, i, j)
        for i, j in combinations(sorted(legs_left, reverse=True), 2)
        if (distance := math.dist(places[i], places[j])) <= STRIDE_M
    )
    persons += [[i] for i in np.flatnonzero(both).tolist()]
    for _, i, j in near:
        if {i, j} <= legs_left:
            legs_left -= {i, j}
            persons.append([i, j])
    return persons + [[i] for i in sorted(legs_left)]
