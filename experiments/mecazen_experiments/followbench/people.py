"""People of Follow-Bench 1.0: they plan a path on a grid, and give way by ORCA.

J. van den Berg, S. J. Guy, M. Lin & D. Manocha, Reciprocal n-body collision avoidance, Robotics
Research, 2011. In this variant only the walker's own radius counts, all others are neighbours, and
blocked cells of the grid have lines of their own. The horizon is 1 s, or one step for neighbours
that are nearer than the radius. People choose velocities one after the other, so each uses the new
places of those before. A walker changes its velocity at once, and brakes when it touches something.

Plain numbers are four times as fast as arrays for the twenty lines of a walker.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from mecazen.portable import Floats
from scipy.ndimage import binary_dilation

from mecazen_experiments.followbench.episodes import STEP_S, Box, Episode, Walk
from mecazen_experiments.followbench.robot import PERSON_RADIUS, Unicycle, gaps

SPEED_M_S = 1.5
"""Preferred and maximum speed."""
CELL_M = 0.2
"""Edge of a cell [m]."""
SKIP = 5
"""Number of cells from one way-point to the next."""
NEAR_CELLS, NEAR_AT_MOST = 2, 10
"""Range [cells] and number of the blocked cells that a walker heeds."""
STEPS = ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))
SKIN_M = 0.1
"""Margin that ORCA adds to a body's radius."""
GROWN_M = 0.05
"""Margin of a body; if the body with this margin touches something, the walker brakes ..."""
BRAKED = 1.0 / 20.0
"""... to this share of the velocity, after a step at rest."""
SLOW_M, ARRIVED_M = 1.0, 0.1
"""Distances of a way-point below which the walker slows down, and stands."""
PARALLEL = 1e-6
"""Sine below which two lines count as parallel."""

Flags = npt.NDArray[np.bool_]
Cell = tuple[int, int]
"""A cell's row (along y) and column (along x)."""
Vector = tuple[float, float]
Line = tuple[float, float, float, float]
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

    def near(self, x: float, y: float) -> list[Vector]:
        """Return the middles of the blocked cells around a place, the nearest first [m]."""
        row, column = self._cell((x, y))
        low, left = max(0, row - NEAR_CELLS), max(0, column - NEAR_CELLS)
        region = self.heeded[low : row + NEAR_CELLS + 1, left : column + NEAR_CELLS + 1]
        if not region.any():
            return []
        cells = [_middle((low + i, left + j)) for i, j in np.argwhere(region).tolist()]
        cells.sort(key=lambda cell: (cell[0] - x) ** 2 + (cell[1] - y) ** 2)
        return cells[:NEAR_AT_MOST]

    def _cell(self, place: Vector) -> Cell:
        """Return the cell of a place; the nearest one if the place is outside."""
        (row, column), (rows, columns) = _index(place), self.blocked.shape
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)

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
                i, j = neighbour = cell[0] + di, cell[1] + dj
                if not (0 <= i < rows and 0 <= j < columns) or blocked[i, j]:
                    continue
                step = math.sqrt(2.0) if di and dj else 1.0
                through = so_far + step + _straight(neighbour, goal)
                if through < best.get(neighbour, math.inf):
                    best[neighbour] = through
                    parents[neighbour] = cell
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
        self.walks = (episode.target, *episode.humans)
        self.states = [(walk.start.x, walk.start.y, 0.0, 0.0) for walk in self.walks]
        """Place and velocity of the target, then of each of the others [m, m/s]."""
        self._grid = Grid(episode)
        self._paths = [self._grid.path(walk) for walk in self.walks]
        self._next = [0] * len(self.walks)
        self._braking = [False] * len(self.walks)
        self._boxes = np.array(episode.boxes).reshape(-1, 5)
        # as in Follow-Bench, people also avoid the centres of boxes and an object at the origin
        self._things = [(0.0, 0.0, 0.0, 0.0), *((box.x, box.y, 0.0, 0.0) for box in episode.boxes)]

    @property
    def places(self) -> Floats:
        """The target's place, then those of the others (1 + n, 2) [m]."""
        return np.array(self.states)[:, :2]

    def step(self, robot: Unicycle) -> None:
        """Advance by a step beside a robot; the target does not give way to it."""
        v, yaw = robot.v, robot.pose.yaw
        moving = robot.pose.x, robot.pose.y, v * math.cos(yaw), v * math.sin(yaw)
        near = (gaps(robot.pose, self.places) <= GROWN_M) | self._at_boxes()
        for n, (last_x, last_y, *_) in enumerate(self.states):
            neighbours = [*self.states[:n], *self.states[n + 1 :]]
            touches = bool(near[n]) or _touches(self.states[n], neighbours)
            vx, vy = self._choice(n, [*neighbours, *self._things, *([moving] if n else [])])
            stands, self._braking[n] = touches and not self._braking[n], touches
            if touches:
                vx, vy = (0.0, 0.0) if stands else (BRAKED * vx, BRAKED * vy)
            x, y = last_x + STEP_S * vx, last_y + STEP_S * vy
            self.states[n] = x, y, vx, vy
            goal_x, goal_y = self._paths[n][self._next[n]]
            if math.hypot(goal_x - x, goal_y - y) < self.walks[n].goal_threshold:
                self._next[n] = min(self._next[n] + 1, len(self._paths[n]) - 1)

    def _choice(self, n: int, neighbours: Iterable[Sequence[float]]) -> Vector:
        """Return the velocity that a walker chooses [m/s]."""
        x, y, vx, vy = self.states[n]
        goal_x, goal_y = self._paths[n][self._next[n]]
        dx, dy = goal_x - x, goal_y - y
        distance = math.hypot(dx, dy)
        part = 0.0
        if distance >= ARRIVED_M:
            part = SPEED_M_S * min(distance / SLOW_M, 1.0) / distance
        radius = PERSON_RADIUS + SKIN_M + self.walks[n].safe_dist
        cells = self._grid.near(x, y)
        return orca((x, y), (vx, vy), (part * dx, part * dy), neighbours, cells, radius)

    def _at_boxes(self) -> Flags:
        """Return which people touch a box, with their margin (n)."""
        x, y, yaw, length, width = self._boxes.T
        dx, dy = self.places[:, :1] - x, self.places[:, 1:] - y
        c, s = np.cos(yaw), np.sin(yaw)
        over = np.maximum(np.abs(c * dx + s * dy) - length / 2.0, 0.0)
        beside = np.maximum(np.abs(c * dy - s * dx) - width / 2.0, 0.0)
        touches = np.hypot(over, beside) <= PERSON_RADIUS + GROWN_M
        return np.asarray(touches.any(axis=1))


def _touches(state: Sequence[float], neighbours: Iterable[Sequence[float]]) -> bool:
    """Return whether a walker's body with its margin touches another walker."""
    reach = (2.0 * PERSON_RADIUS + GROWN_M) ** 2
    x, y, *_ = state
    return any((px - x) * (px - x) + (py - y) * (py - y) <= reach for px, py, *_ in neighbours)


def orca(
    place: Vector,
    velocity: Vector,
    preferred: Vector,
    neighbours: Iterable[Sequence[float]],
    cells: Iterable[Sequence[float]],
    radius: float,
) -> Vector:
    """Return the permitted velocity that is nearest to the preferred one [m/s].

    Args:
        place: The walker's place [m].
        velocity: The walker's velocity [m/s].
        preferred: The preferred velocity [m/s].
        neighbours: x, y and velocity of each neighbour [m, m/s].
        cells: x and y of blocked cells near by [m].
        radius: Distance to be kept between centres [m].
    """
    (x, y), (vx, vy) = place, velocity
    relative = [(px - x, py - y, vx - ux, vy - uy) for px, py, ux, uy in neighbours]
    relative.sort(key=_squared)
    lines = [_line(neighbour, velocity, radius, 0.5) for neighbour in relative]
    fixed = [(px - x, py - y, vx, vy) for px, py in cells]
    # as in Follow-Bench, a cell nearer than the radius has no line
    lines += [_line(cell, velocity, radius, 1.0) for cell in fixed if _squared(cell) > radius**2]
    failed, chosen = _nearest(lines, preferred)
    if failed < len(lines):
        chosen = _least_bad(lines, failed, len(fixed), chosen)
    return chosen


def _squared(vector: Sequence[float]) -> float:
    return vector[0] * vector[0] + vector[1] * vector[1]


def _line(relative: Line, velocity: Vector, radius: float, share: float) -> Line:
    """Return the line (half-plane) of velocities that avoid a neighbour.

    Args:
        relative: Vector to the neighbour [m], and the walker's velocity minus the neighbour's.
        velocity: The walker's velocity [m/s].
        radius: Distance to be kept [m].
        share: Part of the change of velocity that the walker makes.
    """
    px, py, vx, vy = relative
    squared = px * px + py * py
    far = squared > radius * radius
    rate = 1.0 if far else 1.0 / STEP_S
    wx, wy = vx - rate * px, vy - rate * py
    length = max(math.sqrt(wx * wx + wy * wy), 1e-12)
    dot = wx * px + wy * py
    if not far or (dot < 0.0 and -dot > radius * length):
        # the nearest edge of the forbidden velocities is their round end
        dx, dy = wy / length, -wx / length
        excess = radius * rate - length
        ux, uy = -excess * dy, excess * dx
    else:
        leg = math.sqrt(squared - radius * radius)
        side = 1.0 if px * wy - wx * py > 0.0 else -1.0
        dx = (side * px * leg - py * radius) / squared
        dy = (px * radius + side * py * leg) / squared
        along = vx * dx + vy * dy
        ux, uy = along * dx - vx, along * dy - vy
    return dx, dy, velocity[0] + share * ux, velocity[1] + share * uy


def _nearest(
    lines: Sequence[Line], preferred: Vector, *, is_direction: bool = False
) -> tuple[int, Vector]:
    """Return the number of the first line that can't be met, and the best velocity.

    The velocity meets all lines before that line. If all lines are met, the number is their count.
    With `is_direction`, the best velocity is the one that goes farthest in a direction.
    """
    x, y = preferred
    if is_direction:
        x, y = x * SPEED_M_S, y * SPEED_M_S
    elif x * x + y * y > SPEED_M_S**2:
        speed = math.sqrt(x * x + y * y)
        x, y = x / speed * SPEED_M_S, y / speed * SPEED_M_S
    for number, (dx, dy, px, py) in enumerate(lines):
        if dx * (py - y) - (px - x) * dy > 0.0:
            best = _on_line(lines, number, preferred, is_direction)
            if best is None:
                return number, (x, y)
            x, y = best
    return len(lines), (x, y)


def _on_line(
    lines: Sequence[Line], number: int, preferred: Vector, is_direction: bool
) -> Vector | None:
    """Return the best velocity on a line that all lines before it permit; None: there is none."""
    dx, dy, px, py = lines[number]
    dot = px * dx + py * dy
    room = dot * dot + SPEED_M_S**2 - (px * px + py * py)
    if room < 0.0:
        return None
    low, high = -dot - math.sqrt(room), -dot + math.sqrt(room)
    for ex, ey, qx, qy in lines[:number]:
        denominator = dx * ey - ex * dy
        numerator = ex * (py - qy) - (px - qx) * ey
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
    wx, wy = preferred
    if is_direction:
        best = high if wx * dx + wy * dy > 0.0 else low
    else:
        best = min(max(dx * (wx - px) + dy * (wy - py), low), high)
    return px + best * dx, py + best * dy


def _least_bad(lines: Sequence[Line], failed: int, skipped: int, velocity: Vector) -> Vector:
    """Return the velocity that violates the lines least, beginning with the line `failed`.

    As in Follow-Bench, the first `skipped` lines, as many as there are cells, are left out.
    """
    worst, (x, y) = 0.0, velocity
    for number in range(failed, len(lines)):
        dx, dy, px, py = lines[number]
        if dx * (py - y) - (px - x) * dy <= worst:
            continue
        between = []
        for ex, ey, qx, qy in lines[skipped:number]:
            determinant = dx * ey - ex * dy
            if abs(determinant) > PARALLEL:
                t = (ex * (py - qy) - (px - qx) * ey) / determinant
                point = px + t * dx, py + t * dy
            elif dx * ex + dy * ey > 0.0:
                continue
            else:
                point = 0.5 * (px + qx), 0.5 * (py + qy)
            tx, ty = ex - dx, ey - dy
            length = max(math.sqrt(tx * tx + ty * ty), 1e-12)
            between.append((tx / length, ty / length, *point))
        _, (x, y) = _nearest(between, (-dy, dx), is_direction=True)
        worst = dx * (py - y) - (px - x) * dy
    return x, y
