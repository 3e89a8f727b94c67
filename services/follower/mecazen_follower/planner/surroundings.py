"""The robot's surroundings: standing points, walking people, and what both hide."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from mecazen.drive import Array
from mecazen.geometry import Pose2D
from mecazen.messages import LaserScan
from mecazen.portable import Floats, arctan2
from mecazen.scan import BOTH_LEGS_M, clusters, ranges_of
from mecazen.walkers import STILL_M_S, Walkers

from mecazen_follower.perception import GAP_M, persons

VOXEL_M = 0.1
"""One point is kept per square of this width [m]."""
MOST_POINTS = 60
"""Maximum number of points; the nearest are kept."""
MEMORY_S = 1.5
"""Time for which a hidden point is remembered [s]."""
BEHIND_M = 0.15
"""A point is hidden by anything that is nearer by at least this distance [m]."""
HALF_STRIDE_M = 0.5
"""Maximum distance of a leg from its person [m]."""
CONFIRMED = 5
"""Minimum number of detections of a walker; fewer may be an edge that comes into view."""
FASTEST_M_S = 2.5
"""Faster tracks are not persons [m/s]."""

CELL_M = 0.06
CELLS = 110
"""Number of cells along each side of a distance field: 3.3 m to each side of the robot."""
BINS = 90
"""Directions about the person, of 2.5° to 5° each."""
MOST_BINS = 12
"""Maximum number of bins that an obstacle covers."""


class LocalMap:
    """Everything that the lidar sees except the followed person, in odom."""

    def __init__(self) -> None:
        self._walkers = Walkers()
        self._points: Floats = np.empty((0, 2))
        self._times: Floats = np.empty(0)

    def see(self, time: float, scan: LaserScan, lidar: Pose2D, person: Pose2D) -> None:
        """Update with a scan that was captured at `time` [s] with the lidar at a pose in odom."""
        ranges = ranges_of(scan)
        seen = clusters(scan, ranges, GAP_M)
        poses = [lidar.compose(pose) for pose, _ in persons(seen)]
        strangers = [pose[:2] for pose in poses if pose.distance(person) > HALF_STRIDE_M]
        self._walkers.update(time, strangers)
        seen = seen.moved(lidar)
        walkers = np.vstack((self.walkers(np.array([time]))[0], [person[:2]]))
        off = seen.middle[:, None] - walkers
        are_beside = np.hypot(off[..., 0], off[..., 1]).min(axis=1) <= HALF_STRIDE_M
        are_legs = (seen.width <= BOTH_LEGS_M) & are_beside
        standing = seen.xy[~are_legs[seen.index]]
        remembered = self._hidden(scan, ranges, lidar) & (self._times > time - MEMORY_S)
        self._points = np.vstack((self._points[remembered], standing))
        self._times = np.concatenate((self._times[remembered], np.full(len(standing), time)))

    def walkers(self, times: Floats) -> Floats:
        """Return the predicted positions of walking people (times, n, 2)."""
        walking = [
            track
            for track in self._walkers.tracks
            if track.detections >= CONFIRMED and STILL_M_S <= track.speed <= FASTEST_M_S
        ]
        places = [[track.at(time) for track in walking] for time in times.tolist()]
        return np.array(places, float).reshape(len(times), len(walking), 2)

    def standing(self, robot: Pose2D) -> Floats:
        """Return the points that stand still (n, 2): the nearest to the robot, thinned out."""
        offsets = self._points - robot[:2]
        order = np.argsort(np.einsum("ij,ij->i", offsets, offsets), kind="stable")
        near = self._points[order]
        voxels = np.floor(near / VOXEL_M).astype(np.int64)
        _, first = np.unique(voxels[:, 0] * (1 << 32) + voxels[:, 1], return_index=True)
        kept: Floats = near[np.sort(first)[:MOST_POINTS]]
        return kept

    def _hidden(self, scan: LaserScan, ranges: Floats, lidar: Pose2D) -> npt.NDArray[np.bool_]:
        """Return which known points are hidden in this scan."""
        offsets = self._points - lidar[:2]
        away = np.hypot(offsets[:, 0], offsets[:, 1])
        if not len(ranges) or not scan.angle_increment:
            return np.ones(len(away), bool)
        angles = arctan2(offsets[:, 1], offsets[:, 0]) - lidar.yaw - scan.angle_min
        turn = abs(math.tau / scan.angle_increment)
        beams = np.round((angles / scan.angle_increment) % turn).astype(int) % round(turn)
        measured = ranges[np.minimum(beams, len(ranges) - 1)]
        hidden: npt.NDArray[np.bool_] = ~(measured >= away - BEHIND_M) | (beams >= len(ranges))
        return hidden


class DistanceField:
    """The distances from `points` (n, 2) [m] around the origin; constant beyond the table's edge.

    Only the part of the table between the corners `low` and `high` (2) [m] is computed.
    """

    def __init__(self, points: Floats, low: Floats, high: Floats) -> None:
        (left, below), (right, above) = (_cells(low) - 1).tolist(), (_cells(high) + 2).tolist()
        x, y = (
            (np.clip(np.arange(*ends), 0, CELLS - 1) - (CELLS - 1) / 2).astype(np.float32)
            * np.float32(CELL_M)
            for ends in ((left, right), (below, above))
        )
        dx, dy = x - points[:, :1].astype(np.float32), y - points[:, 1:].astype(np.float32)
        squares = (dx * dx)[:, :, None] + (dy * dy)[:, None]
        self._table = np.sqrt(squares.min(axis=0, initial=np.inf)).ravel()
        self._width, self._first = len(y), left * len(y) + below

    def distance(self, x: Array, y: Array) -> Array:
        """Return the distances at positions of any shape, accurate to half a cell's diagonal."""
        cells = _cells(x) * self._width
        cells += _cells(y)
        cells -= self._first
        distances: Array = self._table.take(cells)
        return distances


class Shadows:
    """Regions from which the person can't be seen, at each step.

    Args:
        person: The person's positions (steps, 2).
        points: Points that hide the person (steps, n, 2).
        radius: Half the width of each point (n) [m].
    """

    def __init__(self, person: Floats, points: Floats, radius: Floats) -> None:
        steps = len(person)
        nearest = np.full((steps, BINS), np.inf)
        offsets = points - person[:, None]
        x, y = offsets[..., 0], offsets[..., 1]
        ranges = np.hypot(x, y)
        # an obstacle covers its direction ± the half angle with this sine and cosine
        sine = np.minimum(radius / np.maximum(ranges, 1e-6), 1.0)
        cosine = np.sqrt(1.0 - sine * sine)
        first, last = (_bins(x * cosine + y * s, y * cosine - x * s) for s in (sine, -sine))
        covered = (last - first) % BINS
        rows = np.broadcast_to(np.arange(steps)[:, None], first.shape)
        for k in range(min(int(covered.max(initial=-1)) + 1, MOST_BINS)):
            covers = k <= covered
            cells = rows[covers], (first[covers] + k) % BINS
            np.minimum.at(nearest, cells, ranges[covers])
        self._flat = nearest.astype(np.float32).ravel()
        self._rows = np.arange(0, steps * BINS, BINS, dtype=np.int32)[:, None]

    def hide(self, x: Array, y: Array, distance: Array) -> npt.NDArray[np.bool_]:
        """Return whether the person is hidden from robots (steps, n) at offsets from the person."""
        bins = _bins(x, y)
        bins += self._rows
        hidden: npt.NDArray[np.bool_] = self._flat.take(bins) < distance
        return hidden


def _cells(values: Array) -> npt.NDArray[np.int32]:
    cells = values * np.float32(1.0 / CELL_M)
    cells += np.float32(CELLS / 2)
    return cells.astype(np.int32)


def _bins(x: Array, y: Array) -> npt.NDArray[np.int32]:
    """Return the bin of each direction.

    The bins divide y / (|x| + |y|) evenly instead of the angle: arctan2 would take as long as all
    other steps together.
    """
    along = y / np.maximum(np.abs(x) + np.abs(y), 1e-9)
    along = np.where(x < 0.0, 3.0 - along, 1.0 + along)
    bins: npt.NDArray[np.int32] = np.minimum(along * (BINS / 4.0), BINS - 1).astype(np.int32)
    return bins
