"""Scenarios: TOML files, strict about keys, types and ranges, and how they are loaded.

What more than one service needs stands here; each service's own section is a struct in its
own `config.py`, found through the entry points `mecazen.configs`.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from datetime import date, datetime, time
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, cast

import msgspec
import msgspec.inspect as mi

from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen.robot import Robot
from mecazen.schema import AngleDeg, Finite, NonNegative, Positive, Probability, Section

SectionT = TypeVar("SectionT", bound=Section)

ROUTER = "tcp/127.0.0.1:7447"
"""Where processes and tools meet unless the scenario says otherwise."""

KNOWN_SERVICES = ("physics", "controller", "target", "follower", "viewer", "recorder")
"""Sections that a scenario may hold although the service is not installed here."""


class SimConfig(Section):
    """Simulated time."""

    mode: Literal["real_time", "lockstep"] = "real_time"
    """real_time follows the wall clock; lockstep waits for every answer and for nothing else."""
    tick_s: Annotated[float, msgspec.Meta(ge=0.001, le=1.0)] = 0.01
    """The control period; whole nanoseconds."""
    speed: Annotated[float, msgspec.Meta(ge=0.01, le=1000.0)] = 1.0
    """Simulated seconds per wall second in real time."""
    duration_s: Positive = 60.0
    """Length of a lockstep run; a real-time run goes on until it is stopped."""
    answer_timeout_s: Positive = 10.0
    """Wall time after which a service that does not answer a tick in lockstep is an error."""

    @property
    def tick_ns(self) -> int:
        """The control period [ns]."""
        return round(self.tick_s * 1e9)

    @property
    def ticks(self) -> int:
        """Ticks of a lockstep run."""
        return round(self.duration_s / self.tick_s)


class StartConfig(Section):
    """Where the robot stands at first, in world; the odometry begins there too."""

    x_m: Finite = 0.0
    y_m: Finite = 0.0
    yaw_deg: AngleDeg = 0.0

    @property
    def pose(self) -> Pose2D:
        """The pose in world."""
        return Pose2D(self.x_m, self.y_m, math.radians(self.yaw_deg))


class SensorConfig(Section):
    """The robot's person sensor: target simulates it, and the follower knows its data sheet."""

    rate_hz: Positive = 25.0
    """Frames a second; divides the tick rate."""
    frame: Literal["base_link", "world"] = "base_link"
    """Frame of the observed poses; world leaves out the drift of the odometry."""
    position_std_m: NonNegative = 0.05
    yaw_std_deg: NonNegative = 5.0
    latency_s: NonNegative = 0.0
    """From a frame's capture to its arrival; whole ticks."""
    fov_deg: Annotated[float, msgspec.Meta(gt=0.0, le=360.0)] = 360.0
    """Field of view about the robot's x axis."""
    max_range_m: Positive = 10.0
    dropout_probability: Probability = 0.0
    """Chance of a frame to show nothing."""
    occlusions_s: tuple[tuple[NonNegative, NonNegative], ...] = ()
    """Intervals [from, to] of simulated time in which nothing is seen."""

    def __post_init__(self) -> None:
        for begin, end in self.occlusions_s:
            if end <= begin:
                raise ValueError(f"occlusions_s: [{begin}, {end}] must end after it begins")

    def ticks_per_frame(self, tick_s: float) -> int:
        """Return the ticks from one frame to the next.

        Raises:
            ConfigError: The rate does not divide the tick rate.
        """
        return whole_ticks("sensor.rate_hz", 1.0 / self.rate_hz, tick_s)


class BusConfig(Section):
    """Zenoh: loopback and no multicast unless something else is said here."""

    connect: tuple[str, ...] | None = None
    """Endpoints of the router; ["tcp/127.0.0.1:7447"] where neither this nor a file says."""
    listen: tuple[str, ...] | None = None
    """Endpoints of each peer; ["tcp/127.0.0.1:0"], a free port, where nothing else is said."""
    multicast_scouting: bool = False
    """Whether sessions look for each other by multicast."""
    namespace: Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_-]+(/[A-Za-z0-9_-]+)*$")] | None = (
        None
    )
    """Prefix of all keys, put there by Zenoh; one for each robot."""
    format: Literal["json", "msgpack"] = "json"
    """How samples are written; both are always read."""
    zenoh_config: Path | None = None
    """A Zenoh configuration file (JSON5) that the settings above are laid over."""

    @property
    def meeting_point(self) -> tuple[str, ...] | None:
        """Endpoints of the router; None where only the Zenoh configuration file knows."""
        return self.connect or (None if self.zenoh_config else (ROUTER,))


class Scenario(Section):
    """A whole scenario: the robot, who takes part, and every setting."""

    robot: Robot
    """The robot file, relative to the scenario; or the same as a table."""
    services: tuple[str, ...] = ("physics", "controller", "target", "follower")
    """Who takes part in every tick."""
    programs: dict[str, str] = msgspec.field(default_factory=dict)
    """Your own class in a service's place: `follower = "my_follower.py:MyFollower"`."""
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)] = 0
    sim: SimConfig = SimConfig()
    start: StartConfig = StartConfig()
    sensor: SensorConfig = SensorConfig()
    bus: BusConfig = BusConfig()
    sections: dict[str, Section] = msgspec.field(default_factory=dict)
    """The sections of the services that are installed here, by name."""

    def __post_init__(self) -> None:
        if abs(self.sim.tick_s * 1e9 - self.sim.tick_ns) > 1e-3:
            raise ValueError(f"sim.tick_s = {self.sim.tick_s} must be whole nanoseconds")
        if self.sim.ticks < 1:
            raise ValueError(
                f"sim.duration_s = {self.sim.duration_s} must be at least a tick of "
                f"sim.tick_s = {self.sim.tick_s}"
            )
        if len(set(self.services)) != len(self.services):
            raise ValueError("services: each at most once")

    def section(self, kind: type[SectionT], name: str) -> SectionT:
        """Return the section of service `name`, its defaults where the file says nothing."""
        section = self.sections.get(name)
        return kind() if section is None else cast(SectionT, section)


def whole_ticks(key: str, seconds: float, tick_s: float) -> int:
    """Return `seconds` in ticks.

    Raises:
        ConfigError: It is not a whole number of ticks; the message names `key`.
    """
    ticks = round(seconds / tick_s)
    if abs(ticks * tick_s - seconds) > 1e-9 * max(1.0, seconds) or (seconds > 0 and ticks == 0):
        raise ConfigError(f"{key}: {seconds:.9g} s is not a whole number of ticks of {tick_s} s")
    return ticks


def installed_sections() -> dict[str, type[Section]]:
    """Return the configuration struct of every service that is installed here."""
    return {entry.name: entry.load() for entry in entry_points(group="mecazen.configs")}


def scenario_path(name: str) -> Path:
    """Return the file of a scenario given by its path or by its name in `configs/scenarios`.

    Raises:
        ConfigError: There is no such file.
    """
    path = Path(name)
    if path.is_file():
        return path
    here = Path.cwd()
    for folder in (here, *here.parents):
        scenarios = folder / "configs" / "scenarios"
        if scenarios.is_dir():
            if (scenarios / f"{name}.toml").is_file():
                return scenarios / f"{name}.toml"
            known = ", ".join(sorted(file.stem for file in scenarios.glob("*.toml")))
            raise ConfigError(f"{name}: no such scenario; a path to a TOML file, or one of {known}")
    raise ConfigError(f"{name}: no such file, and no configs/scenarios here or above")


def load_scenario(path: Path, overrides: tuple[str, ...] = ()) -> Scenario:
    """Load a scenario file and check all of it.

    Args:
        path: The TOML file.
        overrides: `key.path=value` each, the value in TOML; a bare word is a string.

    Raises:
        ConfigError: One line with the file, the key and what is allowed.
    """
    raw = _read_toml(path)
    settings = dict(_parse_override(override) for override in overrides)
    origin = _Origin(path, settings=tuple(settings))
    if "robot" in settings:
        raw["robot"] = settings.pop("robot")
    if isinstance(raw.get("robot"), str):
        robot = path.parent / raw["robot"]
        raw["robot"] = _read_toml(robot)
        origin = origin._replace(robot=robot.resolve())
    for key, value in settings.items():
        _override(raw, key, value)
    if "sections" in raw:
        raise ConfigError(f"{path}: unknown key 'sections'")
    kinds = installed_sections()
    sections = {
        name: raw.pop(name) for name in {**kinds, **dict.fromkeys(KNOWN_SERVICES)} if name in raw
    }
    decoded = {
        name: _convert(section, kinds[name], name, origin)
        for name, section in sections.items()
        if name in kinds
    }
    scenario = _convert(raw, Scenario, "", origin, extra=tuple(kinds))
    for part, program in scenario.programs.items():
        if ".py:" in program:
            # a file of one's own lies beside the scenario, wherever the process is started
            scenario.programs[part] = str((path.parent / program).resolve())
    return msgspec.structs.replace(
        scenario,
        sections={name: decoded.get(name, kind()) for name, kind in sorted(kinds.items())},
    )


def effective(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as plain tables that load to the same scenario again."""
    tables = msgspec.to_builtins(scenario, enc_hook=str)
    tables.update(tables.pop("sections"))
    return cast(dict[str, Any], _without_none(tables))


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except OSError as error:
        raise ConfigError(f"{path}: can't be read: {error.strerror}") from None
    except ValueError as error:  # no UTF-8, or a name that no file can have
        raise ConfigError(_one_line(f"{path}: can't be read: {error}")) from None
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # besides wrong TOML: too many digits
        raise ConfigError(_one_line(f"{path}: not TOML: {error}")) from None


def _parse_override(override: str) -> tuple[str, Any]:
    key, equals, text = override.partition("=")
    key = key.strip()
    if not equals or not re.fullmatch(r"[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)*", key):
        raise ConfigError(_one_line(f"--set {override}: must be key.path=value"))
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return key, text.strip()
    return key, parsed["value"] if len(parsed) == 1 else text.strip()


def _override(raw: dict[str, Any], key: str, value: Any) -> None:
    *tables, last = key.split(".")
    for depth, name in enumerate(tables):
        raw = raw.setdefault(name, {})
        if not isinstance(raw, dict):
            raise ConfigError(f"--set {key}: {'.'.join(tables[: depth + 1])} is not a table")
    raw[last] = value


class _Origin(NamedTuple):
    """Where the values of a scenario come from, for what is said of them."""

    path: Path
    robot: Path | None = None
    settings: tuple[str, ...] = ()
    """The keys that are overridden."""

    def name(self, key: str, problem: str, *, of_table: bool) -> str:
        """Return the file of `key`, and the override that it may come from."""
        file = self.robot if self.robot and key.partition(".")[0] == "robot" else self.path
        for setting in self.settings:
            within = key == setting or key.startswith(f"{setting}.")
            around = setting.startswith(f"{key}.") if key else True
            # what is wrong with a table as a whole names those of its keys that matter
            if within or (around and (not of_table or setting.rpartition(".")[2] in problem)):
                return f"{file} with --set {setting}"
        return str(file)


def _convert(
    raw: Any, kind: type[SectionT], prefix: str, origin: _Origin, extra: tuple[str, ...] = ()
) -> SectionT:
    def to_path(wanted: type, value: Any) -> Path:
        if wanted is not Path or not isinstance(value, str):
            raise ValueError(f"got {_show(value)}")
        resolved = (origin.path.parent / value).resolve()
        if not resolved.is_file():
            raise ValueError(f"{resolved}: no such file")
        return resolved

    try:
        return msgspec.convert(raw, kind, dec_hook=to_path)
    except msgspec.ValidationError as error:
        raise ConfigError(_explain(error, raw, kind, prefix, origin, extra)) from None


def _explain(
    error: msgspec.ValidationError,
    raw: Any,
    kind: type[Section],
    prefix: str,
    origin: _Origin,
    extra: tuple[str, ...],
) -> str:
    """Turn msgspec's message into one line with file, key and what is allowed."""
    problem, _, where = str(error).rpartition(" - at `$")
    if not problem:
        problem, where = where, ""
    steps = re.findall(r"\.?([A-Za-z0-9_-]+)|\[(\d+|\.\.\.)\]", where.rstrip("`"))
    node, value, trail = _descend(mi.type_info(kind), raw, [name or step for name, step in steps])
    # a struct's own checks and those of paths say what is wrong in words of their own
    own_words = error.__cause__ is not None
    unknown = re.match(r"Object contains unknown field `(.*)`$", problem, re.DOTALL)
    missing = re.match(r"Object missing required field `(.*)`$", problem)
    if unknown and not own_words:
        names = sorted([*_fields(node), *(extra if not trail else ())])
        close = difflib.get_close_matches(unknown[1], names, n=1)
        problem = "unknown key; " + (f"did you mean {close[0]}? " if close else "")
        problem += f"allowed: {', '.join(names)}"
        trail = [*trail, unknown[1]]
    elif missing and not own_words:
        problem = f"missing; must be {_describe(_fields(node).get(missing[1], node))}"
        trail = [*trail, missing[1]]
    elif not own_words:
        problem = f"got {_show(value)}; allowed: {_describe(node)}"
    elif not isinstance(node, mi.StructType):
        problem += f"; allowed: {_describe(node)}"
    key = ".".join([prefix, *trail] if prefix else trail)
    of_table = own_words and isinstance(node, mi.StructType)
    source = origin.name(key, problem, of_table=of_table)
    parts = (source, "" if source.endswith(f" with --set {key}") else key, problem)
    return _one_line(": ".join(part for part in parts if part))


def _one_line(text: str) -> str:
    return re.sub(r"[\x00-\x1f\x7f\x85\u2028\u2029]", lambda match: repr(match[0])[1:-1], text)


def _show(value: Any) -> str:
    """Return a value as a reader of TOML expects it, shortened."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) >= 10**40:
        return "a number of too many digits"
    text = str(value) if isinstance(value, datetime | date | time) else repr(value)
    return text if len(text) <= 60 else f"{text[:60]}…"


def _descend(node: mi.Type, value: Any, steps: list[str]) -> tuple[mi.Type, Any, list[str]]:
    """Follow the steps of msgspec's path; return the type and value there, and their keys."""
    trail = []
    for step in steps:
        node = _choose(node, value)
        key = step
        if isinstance(node, mi.DictType):
            # msgspec does not say which: the first that is no string, or no number
            kinds = str if isinstance(node.value_type, mi.StrType) else (int, float)
            wrong = {k: v for k, v in value.items() if type(v) is bool or not isinstance(v, kinds)}
            node, (key, value) = node.value_type, next(iter((wrong or value).items()))
        elif isinstance(node, mi.StructType):
            node, value = _fields(node).get(step, node), value.get(step)
        elif isinstance(node, mi.UnionType):  # no struct has the tag that is given here
            value = value.get(step)
        elif isinstance(node, mi.TupleType):
            node, value = node.item_types[int(step)], value[int(step)]
        elif isinstance(node, mi.VarTupleType | mi.ListType):
            node, value = node.item_type, value[int(step)]
        trail.append(key)
    return _choose(node, value), value, trail


def _choose(node: mi.Type, value: Any) -> mi.Type:
    """Return the member of a union that `value` is meant for: by its tag, else the first."""
    if isinstance(node, mi.Metadata):
        node = node.type
    if not isinstance(node, mi.UnionType):
        return node
    members = [t for t in node.types if not isinstance(t, mi.NoneType)]
    tagged = [t for t in members if isinstance(t, mi.StructType) and isinstance(value, dict)]
    for member in tagged:
        if member.tag_field is not None and value.get(member.tag_field) == member.tag:
            return member
    return members[0] if len(members) == 1 else node


def _fields(node: mi.Type) -> dict[str, mi.Type]:
    """Return what a table may hold: the type of each key, in a union also the tag's."""
    if isinstance(node, mi.UnionType):
        return {
            t.tag_field: node for t in node.types if isinstance(t, mi.StructType) and t.tag_field
        }
    if not isinstance(node, mi.StructType):
        return {}
    tag = {node.tag_field: mi.LiteralType((node.tag,))} if node.tag_field else {}
    return {f.encode_name: f.type for f in node.fields if f.encode_name != "sections"} | tag


def _describe(node: mi.Type) -> str:
    """Return what a value of this type may be, in words."""
    if isinstance(node, mi.Metadata):
        node = node.type
    if isinstance(node, mi.BoolType):
        return "true or false"
    if isinstance(node, mi.FloatType | mi.IntType):
        bounds = [
            f"{sign} {bound:.10g}"
            for sign, bound in ((">", node.gt), (">=", node.ge), ("<", node.lt), ("<=", node.le))
            if bound is not None
        ]
        return " ".join(
            [
                "a number" if isinstance(node, mi.FloatType) else "a whole number",
                " and ".join(bounds),
            ]
        ).strip()
    if isinstance(node, mi.StrType):
        return "a string" + (f" that matches {node.pattern}" if node.pattern else "")
    if isinstance(node, mi.LiteralType):
        return " or ".join(repr(value) for value in node.values)
    if isinstance(node, mi.UnionType):
        tags = [str(t.tag) for t in node.types if isinstance(t, mi.StructType) and t.tag]
        if tags:
            return " or ".join(repr(tag) for tag in tags)
        return " or ".join(_describe(t) for t in node.types if not isinstance(t, mi.NoneType))
    if isinstance(node, mi.VarTupleType | mi.ListType):
        return f"a list, each {_describe(node.item_type)}"
    if isinstance(node, mi.TupleType):
        return "[" + ", ".join(_describe(t) for t in node.item_types) + "]"
    if isinstance(node, mi.StructType):
        return "a robot file, or a table" if node.cls is Robot else "a table"
    if isinstance(node, mi.DictType):
        return f"a table, each value {_describe(node.value_type)}"
    return "a path to a file"
