"""Reads the published episodes of Follow-Bench 1.0: one YAML file each."""

from __future__ import annotations

import csv
import re
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, cast

import msgspec
import yaml
from mecazen.errors import ConfigError
from mecazen.files import read_text
from mecazen.geometry import Pose2D
from mecazen.text import printable

SAMPLE = Path(__file__).with_name("sample")
"""The episodes that come with this package."""
STEP_S = 0.1
"""Duration of a step."""
DISTANCE_M = 1.5
"""Distance that the robot shall keep from the target."""
ROBOT_M = (0.70, 0.55)
"""Length and width of the only robot of the benchmark."""
FILE_NAME = re.compile(r"(.+)_(back|left_side)_\d+")
CLASS = re.compile(r"(?:Normal)?([A-Z][a-z]+)Orca.*")

Place = Literal["back", "left_side"]
"""Place of the robot: behind the target, or beside it, on either side."""


class Walk(NamedTuple):
    """The path of a person: a start, and points after it [m].

    If the person `plans`, the path leads round obstacles. A point is reached at `goal_threshold`
    [m], and `safe_dist` is the distance that the person keeps from others [m].
    """

    start: Pose2D
    goals: tuple[tuple[float, float], ...]
    plans: bool
    goal_threshold: float
    safe_dist: float


class Box(NamedTuple):
    """A rectangular obstacle: centre and yaw in the world, length along its own x axis."""

    x: float
    y: float
    yaw: float
    length: float
    width: float


class Episode(msgspec.Struct, frozen=True):
    """A world with people, and a robot that shall follow one person."""

    name: str
    cls: str
    """Circular, Crowd, Parallel, Perpendicular, Corridor, Intersection, Doorway, Clutter, or the
    name of a track."""
    place: Place
    robot: Pose2D
    """Pose of the rear axle at the start."""
    target: Walk
    humans: tuple[Walk, ...]
    boxes: tuple[Box, ...]
    size: tuple[float, float]
    """Width and height of the world [m]; its corner is at (0, 0)."""
    inflation_cells: int
    """Side of the square, in cells, by which obstacles are inflated for planned paths."""
    max_steps: int
    max_search_steps: int
    """Longest time without sight of the target in a successful episode."""


Coordinate = Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)]
Length = Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)]
State = tuple[Coordinate, Coordinate, Coordinate]


class _Planner(msgspec.Struct):
    dialate: Annotated[int, msgspec.Meta(ge=0, le=100)]
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


class _Behavior(msgspec.Struct):
    name: Literal["orca"]
    """The other half of the benchmark's crowds, with social forces, is not read."""
    safe_dist: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)]


class _Person(msgspec.Struct):
    state: State
    goal: list[Any]
    """One state, or a list of a list of states of which the first is the start."""
    behavior: _Behavior
    plan_path: bool = False
    goal_threshold: Length = 0.1

    def __post_init__(self) -> None:
        is_nested = len(self.goal) == 1 and isinstance(self.goal[0], list)
        states = self.goal[0][1:] if is_nested else [self.goal]
        try:
            self.goal = msgspec.convert(states, list[State], strict=False)
        except msgspec.ValidationError as error:
            raise ValueError(f"goal: {error}") from None
        if not states:
            raise ValueError("goal: must have a state after the start")

    def walk(self) -> Walk:
        goals = tuple((x, y) for x, y, _ in self.goal)
        threshold, safe_dist = self.goal_threshold, self.behavior.safe_dist
        return Walk(Pose2D(*self.state), goals, self.plan_path, threshold, safe_dist)


class _File(msgspec.Struct):
    world: _World
    robot: Annotated[list[_Box], msgspec.Meta(min_length=1, max_length=1)]
    target: Annotated[list[_Person], msgspec.Meta(min_length=1, max_length=1)]
    human: Annotated[list[_Person], msgspec.Meta(max_length=1000)] = []
    obstacle: Annotated[list[_Box], msgspec.Meta(max_length=1000)] = []

    def __post_init__(self) -> None:
        shape = self.robot[0].shape
        if (shape.length, shape.width) != ROBOT_M:
            raise ValueError("robot[0].shape: must be 0.70 x 0.55 m")


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
    return Episode(
        name=path.stem,
        cls=track[1] if track else scenario,
        place=cast(Place, place),
        robot=Pose2D(*file.robot[0].state),
        target=file.target[0].walk(),
        humans=tuple(person.walk() for person in file.human),
        boxes=tuple(Box(*box.state, box.shape.length, box.shape.width) for box in file.obstacle),
        size=(file.world.width, file.world.height),
        inflation_cells=file.world.planner.dialate,
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
