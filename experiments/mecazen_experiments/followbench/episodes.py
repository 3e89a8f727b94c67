"""Reads the published episodes of Follow-Bench 1.0: one YAML file each, with planned paths."""

from __future__ import annotations

import csv
import heapq
import math
import re
from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import msgspec
import numpy as np
import numpy.typing as npt
import yaml
from mecazen.config.people import Goal
from mecazen.config.world import Box
from mecazen.errors import ConfigError
from mecazen.files import read_text
from mecazen.geometry import Pose2D
from mecazen.text import printable
from scipy.ndimage import binary_dilation

SAMPLE = Path(__file__).with_name("sample")
"""The episodes that come with this package."""
STEP_S = 0.1
"""Duration of a step."""
DISTANCE_M = 1.5
"""Distance that the robot shall keep from the target."""
SPEED_M_S, PERSON_M = 1.5, 0.3
"""Preferred speed [m/s] and radius [m] of people."""
BOX_M = 2.0
"""Height of the boxes [m]; those of Follow-Bench have no height."""
CELL_M, SKIP = 0.2, 5
"""Edge of a cell for planned paths [m], and number of cells from one way-point to the next."""
STEPS = ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))
FILE_NAME = re.compile(r"(.+)_(back|left_side)_\d+")
CLASS = re.compile(r"(?:Normal)?([A-Z][a-z]+)Orca.*")

Place = Literal["back", "left_side"]
"""Place of the robot: behind the target, or beside it, on either side."""
Flags = npt.NDArray[np.bool_]
Cell = tuple[int, int]
"""A cell's row (along y) and column (along x)."""
Vector = tuple[float, float]


class Episode(msgspec.Struct, frozen=True):
    """A world with people, and a robot that shall follow one person."""

    name: str
    cls: str
    """Circular, Crowd, Parallel, Perpendicular, Corridor, Intersection, Doorway, Clutter, or the
    name of a track."""
    place: Place
    robot: Pose2D
    """Pose of the rear axle at the start."""
    target: Goal
    """The path of the target; those of people who plan lead round obstacles."""
    humans: tuple[Goal, ...]
    boxes: tuple[Box, ...]
    max_steps: int
    max_search_steps: int
    """Longest time without sight of the target in a successful episode."""


Coordinate = Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)]
Length = Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)]
State = tuple[Coordinate, Coordinate, Coordinate]


class _Planner(msgspec.Struct):
    dialate: Annotated[int, msgspec.Meta(ge=0, le=100)]
    """Side of the square, in cells, by which obstacles are inflated."""
    skip_num: Literal[5]


class _World(msgspec.Struct):
    height: Length
    width: Length
    step_time: Annotated[float, msgspec.Meta(ge=STEP_S, le=STEP_S)]
    planner: _Planner


class _Rectangle(msgspec.Struct):
    name: Literal["rectangle"]
    length: Length
    width: Length


class _Box(msgspec.Struct):
    shape: _Rectangle
    state: State

    def box(self) -> Box:
        (x, y, yaw), shape = self.state, self.shape
        size = shape.length, shape.width, BOX_M
        return Box(size_m=size, position_m=(x, y), yaw_deg=math.degrees(yaw))


class _Person(msgspec.Struct):
    state: State
    goal: list[Any]
    """One state, or a list of a list of states of which the first is the start."""
    plan_path: bool = False

    def __post_init__(self) -> None:
        is_nested = len(self.goal) == 1 and isinstance(self.goal[0], list)
        states = self.goal[0][1:] if is_nested else [self.goal]
        try:
            self.goal = msgspec.convert(states, list[State], strict=False)
        except msgspec.ValidationError as error:
            raise ValueError(f"goal: {error}") from None
        if not states:
            raise ValueError("goal: must have a state after the start")

    def path(self, blocked: Flags) -> Goal:
        x, y, yaw = self.state
        points = goals = [(x, y) for x, y, _ in self.goal]
        if self.plan_path:
            points = [point for leg in pairwise([(x, y), *goals]) for point in _leg(blocked, *leg)]
        return Goal(
            x_m=x,
            y_m=y,
            yaw_deg=math.degrees(yaw),
            via_m=tuple(points[:-1]),
            goal_m=goals[-1],
            speed_m_s=SPEED_M_S,
        )


class _File(msgspec.Struct):
    world: _World
    robot: Annotated[list[_Box], msgspec.Meta(min_length=1, max_length=1)]
    target: Annotated[list[_Person], msgspec.Meta(min_length=1, max_length=1)]
    human: Annotated[list[_Person], msgspec.Meta(max_length=1000)] = []
    obstacle: Annotated[list[_Box], msgspec.Meta(max_length=1000)] = []


def read(path: Path) -> Episode:
    """Return the episode of a file.

    Raises:
        ConfigError: One line with the path, the key, and what is allowed.
    """
    names = FILE_NAME.fullmatch(path.stem)
    if names is None:
        raise _invalid(path, "the file's name must be SCENARIO_back_NUMBER.yaml or _left_side_")
    scenario, place = names.groups()
    if scenario not in episode_lengths():
        raise _invalid(path, f"no length is known for an episode of {scenario!r}")
    try:
        # a base loader makes texts only, and these are converted to the types of their keys
        raw = yaml.load(read_text(path), yaml.BaseLoader)  # noqa: S506
        file = msgspec.convert(raw, _File, strict=False)
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise _invalid(path, f"not YAML: {line}{error.problem}") from None
    except (yaml.YAMLError, RecursionError) as error:
        raise _invalid(path, f"not YAML: {error}") from None
    except msgspec.ValidationError as error:
        problem, _, key = str(error).partition(" - at `$.")
        raise _invalid(path, ": ".join(filter(None, (key.rstrip("`"), problem)))) from None
    track = CLASS.fullmatch(scenario)
    max_steps, max_search_steps = episode_lengths()[scenario]
    world, boxes = file.world, tuple(box.box() for box in file.obstacle)
    blocked = _blocked(boxes, (world.width, world.height), world.planner.dialate)
    return Episode(
        name=path.stem,
        cls=track[1] if track else scenario,
        place=cast(Place, place),
        robot=Pose2D(*file.robot[0].state),
        target=file.target[0].path(blocked),
        humans=tuple(person.path(blocked) for person in file.human),
        boxes=boxes,
        max_steps=max_steps,
        max_search_steps=max_search_steps,
    )


@cache
def episode_lengths() -> dict[str, tuple[int, int]]:
    """Return the longest episode and the longest search [steps] of each scenario, by its name."""
    with (SAMPLE / "episode_steps.csv").open(encoding="utf-8", newline="") as file:
        return {
            row["scenario"]: (int(row["max_steps"]), int(row["max_search_steps"]))
            for row in csv.DictReader(file)
        }


def _invalid(path: Path, problem: str) -> ConfigError:
    return ConfigError(printable(f"{path}: {problem}"))


def _blocked(boxes: Sequence[Box], size: Vector, edge: int) -> Flags:
    """Return the cells of a world that are covered by boxes, grown to squares of `edge` cells."""
    columns, rows = (max(1, math.ceil(length / CELL_M)) for length in size)
    covered = np.zeros((rows, columns), dtype=bool)
    for box in boxes:
        covered |= _covered(box, covered.shape)
    # if the edge is even, cells grow farther towards higher indices
    square = np.ones((edge, edge), dtype=bool)
    grown: Flags = binary_dilation(covered, square, origin=edge % 2 - 1) if edge else covered
    return grown


def _leg(blocked: Flags, start: Vector, goal: Vector) -> list[Vector]:
    """Return way-points from a start to a goal; without a free path, the goal."""
    last = blocked.shape[0] - 1, blocked.shape[1] - 1
    # a place outside has the nearest cell
    ends = (
        (min(max(row, 0), last[0]), min(max(column, 0), last[1]))
        for row, column in (_cell(start), _cell(goal))
    )
    cells = _shortest(blocked, *ends)
    if cells is None:
        return [goal]
    middles = [(CELL_M * j + CELL_M / 2.0, CELL_M * i + CELL_M / 2.0) for i, j in cells]
    return [*middles[::SKIP], middles[-1]] if len(middles) > SKIP else middles[-1:]


def _shortest(blocked: Flags, start: Cell, goal: Cell) -> list[Cell] | None:
    """Return the cells of the shortest way over eight neighbours (A*); None: there is none."""
    rows, columns = blocked.shape
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
            if not (0 <= i < rows and 0 <= j < columns) or blocked[i, j]:
                continue
            through = so_far + _straight(cell, neighbour) + _straight(neighbour, goal)
            if through < best.get(neighbour, math.inf):
                best[neighbour], parents[neighbour] = through, cell
                heapq.heappush(queue, (through, neighbour))
    if goal not in parents:
        return [goal] if start == goal else None
    cells = [goal]
    while cells[-1] != start:
        cells.append(parents[cells[-1]])
    return cells[::-1]


def _straight(a: Cell, b: Cell) -> float:
    di, dj = a[0] - b[0], a[1] - b[1]
    return math.sqrt(di * di + dj * dj)


def _cell(place: Vector) -> Cell:
    """Return the row and column of a place, even if it is outside."""
    return int(place[1] / CELL_M), int(place[0] / CELL_M)


def _covered(box: Box, shape: tuple[int, ...]) -> Flags:
    """Return the cells that a box covers, those of its edges included."""
    place = Pose2D(*box.position_m, math.radians(box.yaw_deg))
    dx, dy = box.size_m[0] / 2.0, box.size_m[1] / 2.0
    corners = [
        _cell(place.compose(Pose2D(along, across))[:2])
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
