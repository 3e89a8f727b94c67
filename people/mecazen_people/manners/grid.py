"""The grid on which people find their way: A* over cells that obstacles leave free."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from mecazen.config.world import Box, Cylinder
from mecazen.portable import Floats

CELL_M = 0.2
"""Edge of a cell [m]; as the next three of Follow-Bench."""
SKIP = 5
"""Number of cells from one way-point to the next."""
NEAR_CELLS, NEAR_AT_MOST = 2, 10
"""Range [cells] and number of the blocked cells that a walker heeds."""
STEPS = ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))

Flags = npt.NDArray[np.bool_]
Point = tuple[float, float]
Cell = tuple[int, int]


class Grid:
    """Cells that are blocked by obstacles or too near to them.

    Args:
        obstacles: The obstacles.
        corner: The corner of the area with the least x and y [m].
        size: Extent of the area along x and y [m].
        inflation: Edge of the square that each blocked cell becomes [cells].
    """

    def __init__(
        self, obstacles: Sequence[Box | Cylinder], corner: Point, size: Point, inflation: int
    ) -> None:
        self._corner = corner
        self._shape = tuple(max(1, math.ceil(edge / CELL_M)) for edge in size)
        axes = [
            low + CELL_M * (np.arange(n) + 0.5) for low, n in zip(corner, self._shape, strict=True)
        ]
        x, y = np.meshgrid(*axes, indexing="ij")
        taken = np.zeros(x.shape, dtype=bool)
        for thing in obstacles:
            taken |= _covers(thing, x, y)
        self.blocked = _inflated(taken, inflation)
        self._is_open = not taken.any()

    @classmethod
    def around(
        cls, obstacles: Sequence[Box | Cylinder], places: Sequence[Point], inflation: int
    ) -> Grid:
        """Return the grid of the area that holds all obstacles and places, and no more."""
        corners = [corner for thing in obstacles for corner in _bounds(thing)] + list(places)
        corners = corners or [(0.0, 0.0)]
        low = min(x for x, _ in corners), min(y for _, y in corners)
        high = max(x for x, _ in corners), max(y for _, y in corners)
        return cls(
            obstacles, low, (high[0] - low[0] + CELL_M, high[1] - low[1] + CELL_M), inflation
        )

    def way(self, places: Sequence[Point]) -> list[Point]:
        """Return the way-points from the first place to the last, past all others.

        A leg without a free way is a straight line.
        """
        points: list[Point] = []
        for start, goal in pairwise(places):
            cells = self._path(self._cell(start), self._cell(goal))
            if cells is None:
                points.append(goal)
            elif len(cells) > SKIP:
                points += [self._middle(cell) for cell in (*cells[::SKIP], cells[-1])]
            else:
                points.append(self._middle(cells[-1]))
        return points

    def near(self, x: float, y: float) -> list[Point]:
        """Return the middles of the blocked cells around a place, the nearest first [m]."""
        if self._is_open:
            return []
        i, j = self._cell((x, y))
        low_i, low_j = max(0, i - NEAR_CELLS), max(0, j - NEAR_CELLS)
        region = self.blocked[low_i : i + NEAR_CELLS + 1, low_j : j + NEAR_CELLS + 1]
        cells = [self._middle((low_i + di, low_j + dj)) for di, dj in np.argwhere(region).tolist()]
        cells.sort(key=lambda cell: (cell[0] - x) ** 2 + (cell[1] - y) ** 2)
        return cells[:NEAR_AT_MOST]

    def _cell(self, place: Point) -> Cell:
        """Return the cell of a place; the nearest one if the place is outside."""
        i, j = (
            min(max(int((at - low) / CELL_M), 0), n - 1)
            for at, low, n in zip(place, self._corner, self._shape, strict=True)
        )
        return i, j

    def _middle(self, cell: Cell) -> Point:
        (low_x, low_y), (i, j) = self._corner, cell
        return low_x + CELL_M * (i + 0.5), low_y + CELL_M * (j + 0.5)

    def _path(self, start: Cell, goal: Cell) -> list[Cell] | None:
        """Return the cells of the shortest way over eight neighbours; None: there is none."""
        blocked, (rows, columns) = self.blocked, self._shape
        parents: dict[Cell, Cell] = {}
        best = {start: 0.0}
        queue = [(0.0, start)]
        while queue:
            total, cell = heapq.heappop(queue)
            if cell == goal:
                break
            if total > best[cell]:
                continue
            so_far = total - _straight(cell, goal) if cell != start else 0.0
            for di, dj in STEPS:
                i, j = other = cell[0] + di, cell[1] + dj
                if not (0 <= i < rows and 0 <= j < columns) or blocked[i, j]:
                    continue
                step = math.sqrt(2.0) if di and dj else 1.0
                through = so_far + step + _straight(other, goal)
                if through < best.get(other, math.inf):
                    best[other] = through
                    parents[other] = cell
                    heapq.heappush(queue, (through, other))
        if goal not in parents:
            return [goal] if start == goal else None
        cells = [goal]
        while cells[-1] != start:
            cells.append(parents[cells[-1]])
        return cells[::-1]


def _straight(one: Cell, other: Cell) -> float:
    """Return the distance of two cells [cells]."""
    di, dj = one[0] - other[0], one[1] - other[1]
    return math.sqrt(di * di + dj * dj)


def _covers(thing: Box | Cylinder, x: Floats, y: Floats) -> Flags:
    """Return which places an obstacle covers."""
    dx, dy = x - thing.position_m[0], y - thing.position_m[1]
    if isinstance(thing, Cylinder):
        inside: Flags
        inside = dx * dx + dy * dy <= thing.size_m[0] ** 2
        return inside
    yaw = math.radians(thing.yaw_deg)
    c, s = math.cos(yaw), math.sin(yaw)
    along, across = np.abs(c * dx + s * dy), np.abs(c * dy - s * dx)
    inside = (along <= thing.size_m[0] / 2.0) & (across <= thing.size_m[1] / 2.0)
    return inside


def _bounds(thing: Box | Cylinder) -> tuple[Point, Point]:
    """Return two corners of the rectangle along x and y that holds an obstacle [m]."""
    x, y = thing.position_m
    if isinstance(thing, Cylinder):
        dx = dy = thing.size_m[0]
    else:
        yaw = math.radians(thing.yaw_deg)
        c, s = abs(math.cos(yaw)), abs(math.sin(yaw))
        dx = (c * thing.size_m[0] + s * thing.size_m[1]) / 2.0
        dy = (s * thing.size_m[0] + c * thing.size_m[1]) / 2.0
    return (x - dx, y - dy), (x + dx, y + dy)


def _inflated(taken: Flags, edge: int) -> Flags:
    """Return cells grown to squares of an edge [cells]; an even edge reaches farther up."""
    if not edge:
        return taken
    below, above = (edge - 1) // 2, edge // 2
    for axis in (0, 1):
        grown = taken.copy()
        for shift in range(-below, above + 1):
            grown |= _shifted(taken, shift, axis)
        taken = grown
    return taken


def _shifted(taken: Flags, by: int, axis: int) -> Flags:
    """Return cells shifted along an axis; what leaves the grid is lost."""
    moved = np.zeros_like(taken)
    to = [slice(None), slice(None)]
    of = [slice(None), slice(None)]
    to[axis] = slice(max(by, 0), taken.shape[axis] + min(by, 0))
    of[axis] = slice(max(-by, 0), taken.shape[axis] - max(by, 0))
    moved[tuple(to)] = taken[tuple(of)]
    return moved
