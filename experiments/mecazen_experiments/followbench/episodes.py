"""Reads the published episodes of Follow-Bench 1.0: one YAML file each."""

from __future__ import annotations

import csv
import re
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
import yaml
from mecazen.errors import ConfigError
from mecazen.files import read_text
from mecazen.geometry import Pose2D
from mecazen.text import printable

from mecazen_experiments.followbench.view import Place

SAMPLE = Path(__file__).with_name("sample")
"""The episodes that come with this package."""
MAX_DEPTH = 32
"""Maximum nesting of an episode."""
GOAL_THRESHOLD_M = 0.1
"""Default distance at which a way-point is reached [m]."""
ROBOT_M = (0.70, 0.55)
"""Length and width of the only robot of the benchmark [m]."""
FILE_NAME = re.compile(r"(?P<scenario>.+)_(?P<place>back|left_side)_\d+")
SCENARIO = re.compile(
    r"(?:Normal)?(?P<cls>[A-Z][a-z]+)(?:Orca|Sfm)(?:Obs(?P<obstacles>\d+))?H\d+(?:W(?P<width>.+))?"
)

Manners = Literal["orca", "sfm"]
"""How people avoid each other: velocity obstacles or social forces."""
Loader: Any = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
"""Every value remains a string, which is converted to the type of its key."""


class Walk(NamedTuple):
    """The path of a person."""

    start: Pose2D
    goals: tuple[tuple[float, float], ...]
    """Points (x, y) [m] after the start, in order."""
    plans: bool
    """Whether the person plans a path round obstacles between the points."""
    goal_threshold: float
    """Distance at which a point is reached [m]."""
    safe_dist: float
    """Distance that the person keeps from others [m]."""


class Box(NamedTuple):
    """A rectangular obstacle: centre and yaw in the world, length along its own x axis."""

    x: float
    y: float
    yaw: float
    length: float
    width: float


class Density(NamedTuple):
    """The difficulty of an episode within its class."""

    humans: int
    """Number of people besides the target."""
    width: float | None = None
    """Width of the corridor, of each path of the crossing, or of the door [m]."""
    obstacles: int | None = None
    """Number of boxes in the clutter."""

    @property
    def text(self) -> str:
        """The density as tables show it."""
        parts = [f"{self.humans} people"]
        if self.width is not None:
            parts.append(f"{self.width:g} m wide")
        if self.obstacles is not None:
            parts.append(f"{self.obstacles} boxes")
        return ", ".join(parts)


class EpisodeLength(NamedTuple):
    """The end of an episode, in steps."""

    max_steps: int
    max_search_steps: int
    """Longest time without sight of the target in a successful episode."""


class Episode(msgspec.Struct, frozen=True):
    """A world with people, and a robot that shall follow one person."""

    name: str
    cls: str
    """Circular, Crowd, Parallel, Perpendicular, Corridor, Intersection, Doorway, Clutter, or the
    name of a track."""
    manners: Manners
    place: Place
    density: Density
    robot: Pose2D
    """Pose of the rear axle at the start."""
    target: Walk
    humans: tuple[Walk, ...]
    boxes: tuple[Box, ...]
    size: tuple[float, float]
    """Width and height of the world [m]; its corner is at (0, 0)."""
    step_s: float
    inflation_cells: int
    """Side of the square, in cells of the grid, by which obstacles are inflated for planned
    paths."""
    max_steps: int
    max_search_steps: int
    distance: float = 1.5
    """Distance that the robot shall keep from the target [m]."""


Coordinate = Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)]
Length = Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)]
State = tuple[Coordinate, Coordinate, Coordinate]


class _Planner(msgspec.Struct):
    dialate: Annotated[int, msgspec.Meta(ge=0, le=100)]
    skip_num: Literal[5]
    """Number of cells from one way-point to the next; equal in all files."""


class _World(msgspec.Struct):
    height: Length
    width: Length
    step_time: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)]
    planner: _Planner


class _Rectangle(msgspec.Struct):
    name: Literal["rectangle"]
    length: Length
    width: Length


class _Box(msgspec.Struct):
    shape: _Rectangle
    state: State


class _Behavior(msgspec.Struct):
    name: Manners
    safe_dist: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)]


class _Person(msgspec.Struct):
    state: State
    goal: list[Any]
    """One state, or a list of a list of states of which the first is the start."""
    behavior: _Behavior
    plan_path: bool = False
    goal_threshold: Length = GOAL_THRESHOLD_M


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
    scenario = names["scenario"]
    if scenario not in episode_lengths():
        raise _invalid(path, f"no length is known for an episode of {scenario!r}")
    try:
        file = msgspec.convert(_parse(path), _File, strict=False)
        return _episode(path.stem, scenario, names["place"], file)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$.")
        where = where.rstrip("`")
        raise _invalid(path, f"{where}: {problem}" if where else problem) from None


def read_folder(folder: Path) -> tuple[dict[Path, Episode], list[str]]:
    """Return the episodes below a folder by their files, and a line for each unreadable file.

    Raises:
        ConfigError: There is no YAML file.
    """
    paths = sorted(folder.rglob("*.yaml"))
    if not paths:
        raise ConfigError(printable(f"{folder}: must be a folder with episodes (*.yaml)"))
    episodes: dict[Path, Episode] = {}
    problems: list[str] = []
    for path in paths:
        try:
            episodes[path] = read(path)
        except ConfigError as error:
            problems.append(str(error))
    return episodes, problems


@cache
def episode_lengths() -> dict[str, EpisodeLength]:
    """Return the length of the episodes of each scenario, by its name."""
    with (SAMPLE / "episode_steps.csv").open(encoding="utf-8", newline="") as file:
        return {
            row["scenario"]: EpisodeLength(int(row["max_steps"]), int(row["max_search_steps"]))
            for row in csv.DictReader(file)
        }


def class_and_density(scenario: str, humans: int) -> tuple[str, Density]:
    """Return class and density of a scenario, by its name; each track is a separate class."""
    parts = SCENARIO.fullmatch(scenario)
    if parts is None:
        return scenario, Density(humans)
    width = float(parts["width"] or 0.0)
    obstacles = parts["obstacles"]
    return parts["cls"], Density(humans, width or None, int(obstacles) if obstacles else None)


def _episode(name: str, scenario: str, place: Any, file: _File) -> Episode:
    """Return the episode of a file.

    Raises:
        msgspec.ValidationError: A value is not allowed by the published format.
    """
    robot, world = file.robot[0], file.world
    if (robot.shape.length, robot.shape.width) != ROBOT_M:
        raise _misfit("must be 0.70 x 0.55 m", "robot[0].shape")
    target = _walk(file.target[0], "target[0]")
    humans = tuple(_walk(one, f"human[{i}]") for i, one in enumerate(file.human))
    manners = file.target[0].behavior.name
    for i, one in enumerate(file.human):
        if one.behavior.name != manners:
            raise _misfit(f"must be {manners}, as that of the target", f"human[{i}].behavior.name")
    cls, density = class_and_density(scenario, len(humans))
    length = episode_lengths()[scenario]
    return Episode(
        name=name,
        cls=cls,
        manners=manners,
        place=place,
        density=density,
        robot=Pose2D(*robot.state),
        target=target,
        humans=humans,
        boxes=tuple(Box(*one.state, one.shape.length, one.shape.width) for one in file.obstacle),
        size=(world.width, world.height),
        step_s=world.step_time,
        inflation_cells=world.planner.dialate,
        max_steps=length.max_steps,
        max_search_steps=length.max_search_steps,
    )


def _walk(person: _Person, where: str) -> Walk:
    """Return the path of a person; raises as `_episode`."""
    goal = person.goal
    if goal and isinstance(goal[0], list):
        if len(goal) != 1:
            raise _misfit("must have one list of states", f"{where}.goal")
        goals = _convert(goal[0], list[State], f"{where}.goal[0]")[1:]
    else:
        goals = [_convert(goal, State, f"{where}.goal")]
    if not goals:
        raise _misfit("must have a state after the start", f"{where}.goal[0]")
    return Walk(
        start=Pose2D(*person.state),
        goals=tuple((x, y) for x, y, _ in goals),
        plans=person.plan_path,
        goal_threshold=person.goal_threshold,
        safe_dist=person.behavior.safe_dist,
    )


def _convert(value: Any, kind: Any, where: str) -> Any:
    """Convert a value to a type; raises as `_episode`."""
    try:
        return msgspec.convert(value, kind, strict=False)
    except msgspec.ValidationError as error:
        problem, _, below = str(error).partition(" - at `$")
        raise _misfit(problem, where + below.rstrip("`")) from None


def _misfit(problem: str, where: str) -> msgspec.ValidationError:
    return msgspec.ValidationError(f"{problem} - at `$.{where}`")


def _parse(path: Path) -> Any:
    """Return the content of a YAML file, with all values as strings.

    The parser's events are checked first: the library crashes if a file is nested too deeply, and
    references to other parts of a file could make the content too large.

    Raises:
        ConfigError: One line with the path and the reason.
    """
    text = read_text(path)
    depth = 0
    try:
        for event in yaml.parse(text, Loader):
            if isinstance(event, yaml.AliasEvent):
                raise _invalid(path, "references (*name) are not allowed")
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise _invalid(path, f"nested more than {MAX_DEPTH} deep")
        return yaml.load(text, Loader)  # noqa: S506  # a base loader makes texts only
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise _invalid(path, f"not YAML: {line}{error.problem}") from None
    except yaml.YAMLError as error:
        raise _invalid(path, f"not YAML: {error}") from None


def _invalid(path: Path, problem: str) -> ConfigError:
    return ConfigError(printable(f"{path}: {problem}"))
