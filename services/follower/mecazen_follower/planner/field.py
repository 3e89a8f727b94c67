"""Lookup tables of the distance to obstacles, and of the regions that they hide from the person."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mecazen.drive import Array
from mecazen.portable import Floats

CELL_M = 0.06
CELLS = 110
"""Number of cells along each side of the table: 3.3 m to each side of the robot."""
BINS = 90
"""Directions about the person, of 2.5° to 5° each."""
MOST_BINS = 12
"""Maximum number of bins that an obstacle covers."""


class Field:
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


def _cells(values: Array) -> npt.NDArray[np.int32]:
    cells = values * np.float32(1.0 / CELL_M)
    cells += np.float32(CELLS / 2)
    return cells.astype(np.int32)


def _bins(x: Array, y: Array) -> npt.NDArray[np.int32]:
    """Return the bin of each direction.

    The bins divide y / (|x| + |y|) evenly instead of the angle: arctan2 would take as long as all
    the rest together.
    """
    along = y / np.maximum(np.abs(x) + np.abs(y), 1e-9)
    along = np.where(x < 0.0, 3.0 - along, 1.0 + along)
    bins: npt.NDArray[np.int32] = np.minimum(along * (BINS / 4.0), BINS - 1).astype(np.int32)
    return bins


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
        ranges = np.hypot(offsets[..., 0], offsets[..., 1])
        x, y = offsets[..., 0], offsets[..., 1]
        # an obstacle covers its direction ± the half angle with this sine and cosine
        sine = np.minimum(radius / np.maximum(ranges, 1e-6), 1.0)
        cosine = np.sqrt(1.0 - sine * sine)
        first, last = (_bins(x * cosine + y * s, y * cosine - x * s) for s in (sine, -sine))
        covered = (last - first) % BINS
        rows = np.broadcast_to(np.arange(steps)[:, None], first.shape)
        for k in range(min(int(covered.max(initial=-1)) + 1, MOST_BINS)):
            covers = k <= covered
            where = rows[covers], (first[covers] + k) % BINS
            np.minimum.at(nearest, where, ranges[covers])
        self._flat = nearest.astype(np.float32).ravel()
        self._rows = np.arange(0, steps * BINS, BINS, dtype=np.int32)[:, None]

    def hide(self, x: Array, y: Array, distance: Array) -> npt.NDArray[np.bool_]:
        """Return whether the person is hidden from robots (steps, n) at offsets from the person."""
        bins = _bins(x, y)
        bins += self._rows
        hidden: npt.NDArray[np.bool_] = self._flat.take(bins) < distance
        return hidden
