"""How far obstacles are, and from where they hide the person: tables to look up."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from mecazen_follower.planner.rollout import Array

CELL_M = 0.06
CELLS = 110
"""Along each side of the table: 3.3 m to each side of the robot."""
BINS = 90
"""Directions about the person, of 4° each."""
SPREAD = 5
"""Greatest number of bins to each side that an obstacle covers."""

Floats = npt.NDArray[np.float64]


class Field:
    """The distances from `points` (n, 2) [m], about the origin; beyond the table as at its edge."""

    def __init__(self, points: Floats) -> None:
        at = (np.arange(CELLS, dtype=np.float32) - (CELLS - 1) / 2) * np.float32(CELL_M)
        table = np.full((CELLS, CELLS), np.inf, np.float32)
        for x, y in points.astype(np.float32):
            np.minimum(table, ((at - x) ** 2)[:, None] + (at - y) ** 2, out=table)
        self._table = np.sqrt(table).ravel()

    def distance(self, x: Array, y: Array) -> Array:
        """Return the distances at places of any shape, to half a cell's diagonal."""
        i, j = (
            np.minimum(
                np.maximum(v * np.float32(1.0 / CELL_M) + np.float32(CELLS / 2), 0), CELLS - 1
            ).astype(np.int32)
            for v in (x, y)
        )
        distances: Array = self._table.take(i * CELLS + j)
        return distances


class Shadows:
    """From where the person can't be seen, at each step.

    Args:
        person: Their places (steps, 2).
        points: What hides them (steps, n, 2).
        radius: Half the width of each of the n [m].
    """

    def __init__(self, person: Floats, points: Floats, radius: Floats) -> None:
        steps = len(person)
        nearest = np.full((steps, BINS), np.inf)
        offsets = points - person[:, None]
        ranges = np.hypot(offsets[..., 0], offsets[..., 1])
        angles = np.arctan2(offsets[..., 1], offsets[..., 0])
        bins = np.floor(angles * (BINS / math.tau)).astype(int)
        half = np.arcsin(np.minimum(radius / np.maximum(ranges, 1e-6), 1.0)) * (BINS / math.tau)
        rows = np.broadcast_to(np.arange(steps)[:, None], bins.shape)
        for spread in range(-SPREAD, SPREAD + 1):
            covers = abs(spread) <= half + 0.5
            where = rows[covers], (bins[covers] + spread) % BINS
            np.minimum.at(nearest, where, ranges[covers])
        self._flat = nearest.astype(np.float32).ravel()
        self._rows = np.arange(0, steps * BINS, BINS, dtype=np.int32)[:, None]

    def hide(self, x: Array, y: Array, distance: Array) -> npt.NDArray[np.bool_]:
        """Return whether the person is hidden from robots (steps, n) at offsets from the person."""
        # the bin of -π is the one of π: the table is circular
        bins = (np.arctan2(y, x) * np.float32(BINS / math.tau) + np.float32(BINS)).astype(np.int32)
        bins -= BINS * (bins >= BINS)
        hidden: npt.NDArray[np.bool_] = self._flat.take(self._rows + bins) < distance
        return hidden
