"""Groups the points of a lidar's scan into clusters, and clusters that are legs into persons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt

from mecazen.arrays import compose
from mecazen.geometry import Pose2D
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


class Clusters:
    """The points of a scan, grouped by object.

    Attributes:
        xy: Positions of the points (n, 2) [m].
        starts: Index of the first point of each of k clusters (k).
        counts: Number of points of each cluster (k).
        index: Index of the cluster of each point (n).
        middle: Mean of each cluster's points (k, 2) [m].
        width: Twice the distance of the cluster's farthest point from its middle (k) [m].
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

    def moved(self, frame: Pose2D) -> Clusters:
        """Return the clusters in the parent of their frame."""
        return Clusters(compose(frame, self.xy), self.starts)


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


def clusters(
    scan: LaserScan, ranges: Floats, gap_m: float, farthest_m: float = math.inf
) -> Clusters:
    """Return the points that a scan hits, grouped by object, in the lidar's frame.

    The scan is a circle: an object may begin with the last beams and end with the first.

    Args:
        scan: The scan.
        ranges: Its ranges (n) [m]: `ranges_of`.
        gap_m: Neighbouring points that are farther apart belong to different objects.
        farthest_m: Points beyond this range are left out.
    """
    most = min(scan.range_max, farthest_m)
    (beams,) = np.nonzero((ranges >= scan.range_min) & (ranges <= most))
    angles = scan.angle_min + scan.angle_increment * beams
    xy = ranges[beams, None] * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    if not len(xy):
        return Clusters(xy, beams)
    steps = np.diff(xy, axis=0, append=xy[:1])
    (cuts,) = np.nonzero(steps[:, 0] ** 2 + steps[:, 1] ** 2 > gap_m**2)
    if not len(cuts):  # one object: it begins after the widest gap between its beams
        cuts = np.argmax(np.diff(beams, append=beams[0] + len(ranges)), keepdims=True)
    starts = np.concatenate(([0], cuts[1:] - cuts[0]))
    return Clusters(np.roll(xy, -(cuts[0] + 1), axis=0), starts)


def by_person(
    places: Sequence[Sequence[float]], legs: Flags, both: Flags
) -> list[tuple[list[int], tuple[float, float]]]:
    """Group clusters by person: return the indices of each person's clusters, and their mean [m].

    Args:
        places: Middles of all clusters (k, 2) [m].
        legs: Whether a cluster may be a leg (k); the two nearest to each other are one person's.
        both: Whether a cluster may be two legs that stand together (k).
    """
    single = set(np.flatnonzero(legs).tolist())
    near = sorted(
        (distance, i, j)
        for i, j in combinations(sorted(single, reverse=True), 2)
        if (distance := math.dist(places[i], places[j])) <= STRIDE_M
    )
    persons = [[i] for i in np.flatnonzero(both).tolist()]
    for _, i, j in near:
        if {i, j} <= single:
            single -= {i, j}
            persons.append([i, j])
    persons += [[i] for i in sorted(single)]
    return [
        (members, (_mean([places[i][0] for i in members]), _mean([places[i][1] for i in members])))
        for members in persons
    ]


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)
