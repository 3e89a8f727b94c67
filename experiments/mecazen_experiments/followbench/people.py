"""People of Follow-Bench 1.0: they plan a path on a grid, and give way by ORCA.

J. van den Berg, S. J. Guy, M. Lin & D. Manocha, Reciprocal n-body collision avoidance, Robotics
Research, 2011. In this variant only the walker's own radius counts, all others are neighbours, and
blocked cells of the grid have lines of their own. The horizon is 1 s, or one step for neighbours
that are nearer than the radius. People choose velocities one after the other, so each uses the new
places of those before. A walker changes its velocity at once, and brakes when it touches something.

Vectors are complex numbers x + iy: for the twenty lines of a walker faster than arrays.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from mecazen.arrays import to_rectangle
from mecazen.portable import Floats
from scipy.ndimage import binary_dilation

from mecazen_experiments.followbench.episodes import STEP_S, Box, Episode, Walk
from mecazen_experiments.followbench.robot import PERSON_RADIUS, Unicycle, gaps

SPEED_M_S = 1.5
"""Preferred and maximum speed."""
CELL_M, SKIP = 0.2, 5
"""Edge of a cell [m], and number of cells from one way-point to the next."""
NEAR_CELLS, NEAR_AT_MOST = 2, 10
"""Range [cells] and number of the blocked cells that a walker heeds."""
STEPS = ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))
SKIN_M = 0.1
"""Margin that ORCA adds to a body's radius."""
GROWN_M, BRAKED = 0.05, 1.0 / 20.0
"""Margin with which a body touches something; then the walker rests for a step, and brakes to this
share of its velocity."""
TOUCHING = (2.0 * PERSON_RADIUS + GROWN_M) ** 2
"""Square of the distance between two people who touch [m²]."""
SLOW_M, ARRIVED_M = 1.0, 0.1
"""Distances of a way-point below which the walker slows down, and stands."""
PARALLEL = 1e-6
"""Sine below which two lines count as parallel."""

Flags = npt.NDArray[np.bool_]
Cell = tuple[int, int]
"""A cell's row (along y) and column (along x)."""
Vector = tuple[float, float]
State = tuple[complex, complex]
"""Place [m] and velocity [m/s]."""
Line = tuple[complex, complex]
"""A half-plane of permitted velocities, on the left of a line: the line's direction (a unit vector)
and a velocity on it [m/s]."""


class Grid:
    """Cells of an episode's world that are blocked by boxes or too near to them."""

    def __init__(self, episode: Episode) -> None:
        columns, rows = (max(1, math.ceil(edge / CELL_M)) for edge in episode.size)
        covered = np.zeros((rows, columns), dtype=bool)
        for box in episode.boxes:
            covered |= _covered(box, covered.shape)
        edge = episode.inflation_cells
        # the cells grow to squares; if the edge is even, farther towards higher indices
        square = np.ones((edge, edge), dtype=bool)
        self.blocked: Flags = (
            binary_dilation(covered, square, origin=edge % 2 - 1) if edge else covered
        )
        self.heeded = self.blocked.copy()
        """Blocked cells from which walkers near by keep their distance: as in Follow-Bench, only
        those within a square at the origin."""
        side = min(rows, columns)
        self.heeded[side:] = self.heeded[:, side:] = False

    def path(self, walk: Walk) -> list[Vector]:
        """Return the way-points of a walk.

        A leg for which the grid has no free path is a straight line.
        """
        if not walk.plans:
            return list(walk.goals)
        points: list[Vector] = []
        for start, goal in pairwise((walk.start[:2], *walk.goals)):
            cells = self._path(self._cell(start), self._cell(goal))
            if cells is None:
                points.append(goal)
            elif len(cells) > SKIP:
                points += [_middle(cell) for cell in (*cells[::SKIP], cells[-1])]
            else:
                points.append(_middle(cells[-1]))
        return points

    def near(self, place: complex) -> list[complex]:
        """Return the middles of the blocked cells around a place, the nearest first [m]."""
        row, column = self._cell((place.real, place.imag))
        low, left = max(0, row - NEAR_CELLS), max(0, column - NEAR_CELLS)
        region = self.heeded[low : row + NEAR_CELLS + 1, left : column + NEAR_CELLS + 1]
        if not region.any():
            return []
        cells = [complex(*_middle((low + i, left + j))) for i, j in np.argwhere(region).tolist()]
        return sorted(cells, key=lambda cell: _squared(cell - place))[:NEAR_AT_MOST]

    def _cell(self, place: Vector) -> Cell:
        """Return the cell of a place; the nearest one if the place is outside."""
        (row, column), (rows, columns) = _index(place), self.blocked.shape
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)

    def _path(self, start: Cell, goal: Cell) -> list[Cell] | None:
        """Return the cells of the shortest way over eight neighbours (A*); None: there is none."""
        rows, columns = self.blocked.shape
        parents: dict[Cell, Cell] = {}
        best, queue = {start: 0.0}, [(0.0, start)]
        while queue:
            total, cell = heapq.heappop(queue)
            if cell == goal:
                break
            if total > best[cell]:
                continue
            so_far = total - _straight(cell, goal)  # minus a constant, since the start has 0
            for di, dj in STEPS:
                i, j = neighbour = cell[0] + di, cell[1] + dj
                if not (0 <= i < rows and 0 <= j < columns) or self.blocked[i, j]:
                    continue
                step = math.sqrt(2.0) if di and dj else 1.0
                through = so_far + step + _straight(neighbour, goal)
                if through < best.get(neighbour, math.inf):
                    best[neighbour], parents[neighbour] = through, cell
                    heapq.heappush(queue, (through, neighbour))
        if goal not in parents:
            return [goal] if start == goal else None
        cells = [goal]
        while cells[-1] != start:
            cells.append(parents[cells[-1]])
        return cells[::-1]


def _index(place: Vector) -> Cell:
    """Return the row and column of a place, even if it is outside."""
    return int(place[1] / CELL_M), int(place[0] / CELL_M)


def _middle(cell: Cell) -> Vector:
    return CELL_M * cell[1] + CELL_M / 2.0, CELL_M * cell[0] + CELL_M / 2.0


def _straight(a: Cell, b: Cell) -> float:
    di, dj = a[0] - b[0], a[1] - b[1]
    return math.sqrt(di * di + dj * dj)


def _covered(box: Box, shape: tuple[int, ...]) -> Flags:
    """Return the cells that a box covers, those of its edges included."""
    c, s = math.cos(box.yaw), math.sin(box.yaw)
    dx, dy = box.length / 2.0, box.width / 2.0
    corners = [
        _index((c * along - s * across + box.x, s * along + c * across + box.y))
        for along, across in ((-dx, -dy), (dx, -dy), (dx, dy), (-dx, dy))
    ]
    rows, columns = np.indices(shape)
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


class People:
    """The target and the others of an episode, step by step."""

    def __init__(self, episode: Episode) -> None:
        self._walks = (episode.target, *episode.humans)
        self.states = [(complex(walk.start.x, walk.start.y), 0j) for walk in self._walks]
        """Place and velocity of the target, then of each of the others [m, m/s]."""
        self._grid = Grid(episode)
        self._paths = [[complex(*point) for point in self._grid.path(walk)] for walk in self._walks]
        self._next = [0] * len(self._walks)
        self._braking = [False] * len(self._walks)
        self._boxes = np.array(episode.boxes).reshape(-1, 5)
        # as in Follow-Bench, people also avoid the centres of boxes and an object at the origin
        self._things = [(0j, 0j), *((complex(box.x, box.y), 0j) for box in episode.boxes)]

    @property
    def places(self) -> Floats:
        """The target's place, then those of the others (1 + n, 2) [m]."""
        return np.array([(place.real, place.imag) for place, _ in self.states])

    def step(self, robot: Unicycle) -> None:
        """Advance by a step beside a robot; the target does not give way to it."""
        pose, v = robot.pose, robot.v
        moving = complex(*pose[:2]), complex(v * math.cos(pose.yaw), v * math.sin(pose.yaw))
        near = (gaps(pose, self.places) <= GROWN_M) | self._at_boxes()
        for n in range(len(self.states)):
            place, _ = self.states[n]
            neighbours = [*self.states[:n], *self.states[n + 1 :]]
            touches = bool(near[n]) or any(_squared(p - place) <= TOUCHING for p, _ in neighbours)
            velocity = self._choice(n, [*neighbours, *self._things, *([moving] if n else [])])
            stands, self._braking[n] = touches and not self._braking[n], touches
            if touches:
                velocity *= 0.0 if stands else BRAKED
            place += STEP_S * velocity
            self.states[n] = place, velocity
            off = self._paths[n][self._next[n]] - place
            if math.hypot(off.real, off.imag) < self._walks[n].goal_threshold:
                self._next[n] = min(self._next[n] + 1, len(self._paths[n]) - 1)

    def _choice(self, n: int, neighbours: Iterable[State]) -> complex:
        """Return the velocity that a walker chooses [m/s]."""
        place, velocity = self.states[n]
        off = self._paths[n][self._next[n]] - place
        distance = math.hypot(off.real, off.imag)
        part = 0.0
        if distance >= ARRIVED_M:
            part = SPEED_M_S * min(distance / SLOW_M, 1.0) / distance
        radius = PERSON_RADIUS + SKIN_M + self._walks[n].safe_dist
        return orca(place, velocity, part * off, neighbours, self._grid.near(place), radius)

    def _at_boxes(self) -> Flags:
        """Return which people touch a box, with their margin (n)."""
        x, y, yaw, length, width = self._boxes.T
        dx, dy = self.places[:, :1] - x, self.places[:, 1:] - y
        c, s = np.cos(yaw), np.sin(yaw)
        distances = to_rectangle(c * dx + s * dy, c * dy - s * dx, (length / 2.0, width / 2.0))
        return np.asarray((distances <= PERSON_RADIUS + GROWN_M).any(axis=1))


def _dot(a: complex, b: complex) -> float:
    return (a.conjugate() * b).real


def _cross(a: complex, b: complex) -> float:
    return (a.conjugate() * b).imag


def _squared(vector: complex) -> float:
    return _dot(vector, vector)


def orca(
    place: complex,
    velocity: complex,
    preferred: complex,
    neighbours: Iterable[State],
    cells: Sequence[complex],
    radius: float,
) -> complex:
    """Return the permitted velocity that is nearest to the preferred one [m/s].

    `neighbours` are places and velocities, `cells` the blocked cells near by [m], and `radius` is
    the distance to be kept between centres [m].
    """
    relative = [(position - place, velocity - motion) for position, motion in neighbours]
    relative.sort(key=lambda neighbour: _squared(neighbour[0]))
    lines = [_line(*neighbour, velocity, radius, 0.5) for neighbour in relative]
    # as in Follow-Bench, a cell nearer than the radius has no line
    lines += [
        _line(cell - place, velocity, velocity, radius, 1.0)
        for cell in cells
        if _squared(cell - place) > radius**2
    ]
    failed, chosen = _nearest(lines, preferred)
    if failed < len(lines):
        chosen = _least_bad(lines, failed, len(cells), chosen)
    return chosen


def _line(
    offset: complex, relative: complex, velocity: complex, radius: float, share: float
) -> Line:
    """Return the line (half-plane) of velocities that avoid a neighbour.

    `offset` is the vector to the neighbour, `relative` the walker's velocity minus the neighbour's,
    and `share` the part of the change of velocity that the walker makes.
    """
    squared = _squared(offset)
    is_far = squared > radius * radius
    rate = 1.0 if is_far else 1.0 / STEP_S
    w = relative - rate * offset
    length = max(math.sqrt(_squared(w)), 1e-12)
    dot = _dot(w, offset)
    if not is_far or (dot < 0.0 and -dot > radius * length):
        # the nearest edge of the forbidden velocities is their round end
        direction = complex(w.imag, -w.real) / length
        change = (radius * rate - length) * 1j * direction
    else:
        side = 1.0 if _cross(offset, w) > 0.0 else -1.0
        leg = side * math.sqrt(squared - radius * radius)
        direction = offset * complex(leg, radius) / squared
        change = _dot(relative, direction) * direction - relative
    return direction, velocity + share * change


def _nearest(
    lines: Sequence[Line], preferred: complex, *, is_direction: bool = False
) -> tuple[int, complex]:
    """Return the number of the first line that can't be met, and the best velocity.

    The velocity meets all lines before that line. If all lines are met, the number is their count.
    With `is_direction`, the best velocity is the one that goes farthest in a direction.
    """
    best = preferred
    if is_direction:
        best *= SPEED_M_S
    elif _squared(preferred) > SPEED_M_S**2:
        best = preferred / math.sqrt(_squared(preferred)) * SPEED_M_S
    for number, (direction, point) in enumerate(lines):
        if _cross(direction, point - best) > 0.0:
            on_line = _on_line(lines, number, preferred, is_direction)
            if on_line is None:
                return number, best
            best = on_line
    return len(lines), best


def _on_line(
    lines: Sequence[Line], number: int, preferred: complex, is_direction: bool
) -> complex | None:
    """Return the best velocity on a line that all lines before it permit; None: there is none."""
    direction, point = lines[number]
    dot = _dot(point, direction)
    room = dot * dot + SPEED_M_S**2 - _squared(point)
    if room < 0.0:
        return None
    low, high = -dot - math.sqrt(room), -dot + math.sqrt(room)
    for along, through in lines[:number]:
        denominator = _cross(direction, along)
        numerator = _cross(along, point - through)
        if abs(denominator) <= PARALLEL:
            if numerator < 0.0:
                return None
            continue
        t = numerator / denominator
        if denominator > 0.0:
            high = min(high, t)
        else:
            low = max(low, t)
        if low > high:
            return None
    if is_direction:
        return point + (high if _dot(preferred, direction) > 0.0 else low) * direction
    return point + min(max(_dot(direction, preferred - point), low), high) * direction


def _least_bad(lines: Sequence[Line], failed: int, skipped: int, velocity: complex) -> complex:
    """Return the velocity that violates the lines least, beginning with the line `failed`.

    As in Follow-Bench, the first `skipped` lines, as many as there are cells, are left out.
    """
    worst = 0.0
    for number in range(failed, len(lines)):
        direction, point = lines[number]
        if _cross(direction, point - velocity) <= worst:
            continue
        between = []
        for along, through in lines[skipped:number]:
            determinant = _cross(direction, along)
            if abs(determinant) > PARALLEL:
                crossing = point + _cross(along, point - through) / determinant * direction
            elif _dot(direction, along) > 0.0:
                continue
            else:
                crossing = 0.5 * (point + through)
            turned = along - direction
            between.append((turned / max(math.sqrt(_squared(turned)), 1e-12), crossing))
        _, velocity = _nearest(between, 1j * direction, is_direction=True)
        worst = _cross(direction, point - velocity)
    return velocity
