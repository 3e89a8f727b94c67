"""The grid on which people find their way: A* over cells that obstacles leave free."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from mecazen.config.world import Box, Cylinder

CELL_M = 0.2
"""Edge of a cell [m]; this value and the next three are those of Follow-Bench."""
SKIP = 5
"""Number of cells from one way-point to the next."""
NEAR_CELLS, NEAR_AT_MOST = 2, 10
"""Range [cells] and number of the blocked cells that a walker heeds."""
STEPS = ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))

Flags = npt.NDArray[np.bool_]
Point = tuple[float, float]
Cell = tuple[int, int]
"""A cell's row (along y) and column (along x)."""


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
        columns, rows = (max(1, math.ceil(edge / CELL_M)) for edge in size)
        taken = np.zeros((rows, columns), dtype=bool)
        for thing in obstacles:
            taken |= self._covered(thing, taken.shape)
        self.blocked = _inflated(taken, inflation)
        self.heeded = self.blocked.copy()
        """Blocked cells from which walkers near by keep their distance."""

    def way(self, places: Sequence[Point]) -> list[Point]:
        """Return the way-points from the first place to the last, through all others.

        A leg for which the grid has no free way is a straight line.
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
        row, column = self._cell((x, y))
        low, left = max(0, row - NEAR_CELLS), max(0, column - NEAR_CELLS)
        region = self.heeded[low : row + NEAR_CELLS + 1, left : column + NEAR_CELLS + 1]
        if not region.any():
            return []
        cells = [self._middle((low + di, left + dj)) for di, dj in np.argwhere(region).tolist()]
        cells.sort(key=lambda cell: (cell[0] - x) ** 2 + (cell[1] - y) ** 2)
        return cells[:NEAR_AT_MOST]

    def _index(self, place: Point) -> Cell:
        """Return the row and column of a place, even if it is outside."""
        (low_x, low_y), (x, y) = self._corner, place
        return int((y - low_y) / CELL_M), int((x - low_x) / CELL_M)

    def _cell(self, place: Point) -> Cell:
        """Return the cell of a place; the nearest one if the place is outside."""
        (row, column), (rows, columns) = self._index(place), self.blocked.shape
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)

    def _middle(self, cell: Cell) -> Point:
        (low_x, low_y), (row, column) = self._corner, cell
        return low_x + CELL_M * column + CELL_M / 2.0, low_y + CELL_M * row + CELL_M / 2.0

    def _covered(self, thing: Box | Cylinder, shape: tuple[int, ...]) -> Flags:
        """Return the cells that an obstacle covers; in a box, those of its edges as well."""
        rows, columns = np.indices(shape)
        covered: Flags
        if isinstance(thing, Cylinder):
            (low_x, low_y), (x, y) = self._corner, thing.position_m
            dx = low_x + CELL_M * columns + CELL_M / 2.0 - x
            dy = low_y + CELL_M * rows + CELL_M / 2.0 - y
            covered = dx * dx + dy * dy <= thing.size_m[0] ** 2
            return covered
        corners = [self._index(corner) for corner in _corners(thing)]
        covered = np.ones(shape, dtype=bool)
        for axis, index in enumerate((rows, columns)):
            edges = [corner[axis] for corner in corners]
            covered &= (min(edges) <= index) & (index <= max(edges))
        for (row, column), (to_row, to_column) in pairwise((*corners, corners[0])):
            along, up = to_column - column, to_row - row
            outside = up * (columns - column) - along * (rows - row)
            # an edge has the cells whose middles are at most half a cell outside
            covered &= 2 * outside <= max(abs(along), abs(up))
        return covered

    def _path(self, start: Cell, goal: Cell) -> list[Cell] | None:
        """Return the cells of the shortest way over eight neighbours; None: there is none."""
        blocked, (rows, columns) = self.blocked, self.blocked.shape
        parents: dict[Cell, Cell] = {}
        best = {start: 0.0}
        queue = [(0.0, start)]
        while queue:
            total, cell = heapq.heappop(queue)
            if cell == goal:
                break
            if total > best[cell]:
                continue
            so_far = total - _straight(cell, goal)  # minus a constant, since the start has 0
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


def _corners(thing: Box) -> list[Point]:
    """Return the corners of a box, counter-clockwise [m]."""
    (x, y), yaw = thing.position_m, math.radians(thing.yaw_deg)
    c, s = math.cos(yaw), math.sin(yaw)
    dx, dy = thing.size_m[0] / 2.0, thing.size_m[1] / 2.0
    return [
        (c * along - s * across + x, s * along + c * across + y)
        for along, across in ((-dx, -dy), (dx, -dy), (dx, dy), (-dx, dy))
    ]


def _inflated(taken: Flags, edge: int) -> Flags:
    """Return cells grown to squares of an edge [cells]; if even, farther towards higher indices."""
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
    if abs(by) >= taken.shape[axis]:
        return moved
    to = [slice(None), slice(None)]
    of = [slice(None), slice(None)]
    to[axis] = slice(max(by, 0), taken.shape[axis] + min(by, 0))
    of[axis] = slice(max(-by, 0), taken.shape[axis] - max(by, 0))
    moved[tuple(to)] = taken[tuple(of)]
    return moved
