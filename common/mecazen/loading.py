"""Scenarios from TOML files: strict about keys, types and ranges, with overrides."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral, Real
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple, cast

import msgspec
import tomli_w

from mecazen import keys
from mecazen.config import BusConfig, Scenario, with_guard
from mecazen.config.scenario import NO_KEYS, scenario_with
from mecazen.config.sensors import features
from mecazen.errors import ConfigError, UntrustedError
from mecazen.explain import explain, fields_of_choice, one_line, show
from mecazen.files import parse_toml, parse_value, read_toml
from mecazen.graph import COLLECTOR, CROWD, NODES, rows
from mecazen.occupancy import take_map
from mecazen.programs import find
from mecazen.robot import Robot
from mecazen.schema import Folder, Output, Section, SectionT
from mecazen.text import printable

OWN = Path(__file__).parent
"""Folder of the package; its `configs` holds the scenarios, robots and worlds of the package."""
SCENARIO_VARIABLE, SETTINGS_VARIABLE = "MECAZEN_SCENARIO", "MECAZEN_SET"
"""Environment variables with a scenario and its overrides (separated by spaces), used if no
scenario and no overrides are given."""
_SECTIONS: dict[str, Any] = {field.name: field.type for field in msgspec.structs.fields(Scenario)}
"""The types of a scenario's fields."""


def scenario_path(name: str) -> Path:
    """Return the file of a scenario given by its path or by its name in `configs/scenarios`.

    Raises:
        ConfigError: There is no such file.
    """
    return given_file(name, "scenario")


def given_file(name: str, kind: str) -> Path:
    """Return a TOML file given on the command line by its path or as in `named_file`.

    A folder, a pipe or a device is returned as well: `read_toml` refuses it with a message.

    Raises:
        ConfigError: There is no such file.
    """
    path = Path(name)
    if path.is_file():
        return path
    try:
        return named_file(name, kind)
    except ConfigError:
        if name and path.exists():
            return path
        raise


def named_file(name: str, kind: str, where: str = "") -> Path:
    """Return a TOML file by its name in `configs/<kind>s`.

    The folder `configs` is in the working directory, in a folder above it, or in the package.

    Raises:
        ConfigError: There is no such file; the message begins with `where`.
    """
    above = (Path.cwd(), *Path.cwd().parents, OWN)
    folder = next(c for folder in above if (c := folder / "configs" / f"{kind}s").is_dir())
    if (file := folder / f"{name}.toml").is_file():
        return file
    known = sorted(file.stem for file in folder.glob("*.toml"))
    shown = one_line(name) or "''"
    close = difflib.get_close_matches(name, known, n=1)
    meant = f"did you mean {close[0]}? " if close else ""
    raise ConfigError(
        f"{where}{shown}: no such {'file' if name.endswith('.toml') else kind}; {meant}a path to a "
        f"TOML file, or one of {', '.join(known)}"
    )


def load_scenario(path: Path, settings: Mapping[str, Any] = {}) -> Scenario:
    """Load a scenario file and check all of it.

    A path is relative to the file that contains it, and in a setting to the working directory.

    Args:
        path: The TOML file.
        settings: Values that replace those of the file, by key: `{"sim.tick_s": 0.02}`.

    Raises:
        ConfigError: One line with the file, the key and the allowed values.
    """
    return from_tables(read_toml(path), path, settings)


def with_settings(scenario: Scenario, settings: Mapping[str, Any]) -> Scenario:
    """Return a scenario with other settings, as `load_scenario` takes them.

    Raises:
        ConfigError: One line with the key and the allowed values.
    """
    return from_tables(effective(scenario), Path("scenario"), settings)


def parse_settings(overrides: Iterable[str]) -> dict[str, Any]:
    """Return settings by key from texts `key.path=value`, as `--set` takes them.

    A value is in TOML; a bare word is a string.

    Raises:
        ConfigError: A text is no such setting.
    """
    return dict(_parse_override(override) for override in overrides)


def from_tables(
    raw: dict[str, Any],
    path: Path,
    settings: Mapping[str, Any] = {},
    *,
    opens_files: bool = True,
) -> Scenario:
    """Check the tables of a scenario, as `load_scenario` does; `path` is the file that has them.

    Raises:
        ConfigError: One line with the file, the key and the allowed values.
        UntrustedError: The tables name a file, and `opens_files` is false.
    """
    settings = _plain(settings)
    given = _strings(list(settings.values()))
    origin = _Origin(path, settings=tuple(settings), given=given, opens_files=opens_files)
    if not opens_files:
        _refuse_files(raw, path)
    for part in ("robot", "world"):
        if part in settings:
            raw[part] = settings.pop(part)
        if (file := _read_part(part, raw, origin)) is not None:
            changes = (*origin.changes, *file[1])
            origin = origin._replace(files={**origin.files, part: file[0]}, changes=changes)
    # a kind comes first, since it drops keys of another kind from the file
    for key, value in sorted(settings.items(), key=lambda setting: not _is_kind(setting[0])):
        _override(raw, key, value)
    if isinstance(world := raw.get("world"), dict):
        take_map(world, origin.locate)  # an override may name a map
    for name in NO_KEYS:
        if name in raw:
            raise ConfigError(f"{path}: unknown key '{name}'")
    _take_programs(raw, origin)
    _take_sensors(raw)
    for robot in _tables(raw.get("robots")):
        _complete(robot, raw, origin)
    return _convert(raw, scenario_with(**_own_sections(raw, origin)), "", origin)


def _refuse_files(raw: dict[str, Any], path: Path) -> None:
    """Refuse a robot or a world that names a file or a map."""
    for table in (raw, *_tables(raw.get("robots"))):
        for part in ("robot", "world"):
            given = table.get(part, {})
            if not isinstance(given, dict) or given.keys() & {"file", "map"}:
                raise UntrustedError(f"{path}: {part} would be read from another file")


def _read_part(
    part: str, table: dict[str, Any], origin: _Origin
) -> tuple[Path, Sequence[str]] | None:
    """Read the file of a robot or a world that a table names; apply the table's other values to it.

    The value in the table is a path, the name of a provided file, or a table with either of them:
    `{ file = "nexus", payload = { … } }`. Return the file and the changed keys; None if the table
    names no file.
    """
    given = table.get(part)
    changes = dict(given) if isinstance(given, dict) else {"file": given}
    name = changes.pop("file", None)
    file: Path | None = None
    if isinstance(name, str):
        ours = re.fullmatch(r"[\w-]+", name)
        where = f"{origin.name(part, 'file', True)}: {part}: "
        file = named_file(name, part, where) if ours else origin.locate(name)
    below = read_toml(file) if file else {}
    if part == "world":
        take_map(below, _Origin(file or origin.path).locate)
        take_map(changes, origin.locate)
    if isinstance(given, dict) or file:
        table[part] = _laid_over(below, changes)
    return None if file is None else (file.resolve(), tuple(f"{part}.{key}" for key in changes))


def _take_programs(raw: dict[str, Any], origin: _Origin) -> None:
    """Resolve the paths of user programs, and add user nodes to the services.

    Wrong types are refused when the tables are converted.
    """
    programs = raw.get("programs")
    if not isinstance(programs, dict):
        return
    taken = {"router", "clock", COLLECTOR, "guard"} | (_SECTIONS.keys() - NODES.keys())
    for part, program in programs.items():
        if part in taken or not re.fullmatch("[A-Za-z0-9_-]+", part):
            raise ConfigError(
                f"{origin.path}: programs: {part!r} can't be a node's name; a name of its own, of "
                "letters, digits, _ and -, can"
            )
        if isinstance(program, str) and ".py:" in program:
            programs[part] = str(origin.locate(program).resolve())
    listed = raw.get("services", Scenario.__struct_defaults__[0])
    own = [name for name in programs if name not in NODES and name not in listed]
    if own and isinstance(listed, list | tuple):
        raw["services"] = [*listed, *own]


def _take_sensors(raw: dict[str, Any]) -> None:
    """Add the services that the kind of sensor needs, and the crowd if it is needed.

    The crowd is needed if others walk, or if several robots see each other and all persons. Wrong
    types are refused when the tables are converted.
    """
    sensor, listed = raw.get("sensor", {}), raw.get("services", Scenario.__struct_defaults__[0])
    if not isinstance(sensor, dict) or not isinstance(listed, list | tuple):
        return
    also = sensor.get("also", ())
    wanted = features(str(sensor.get("kind")), [*map(str, also)] if isinstance(also, list) else [])
    guard = raw.get("guard")
    enabled = not isinstance(guard, dict) or guard.get("enabled") is not False
    wanted = with_guard(wanted, enabled=enabled)
    always = {row.name for row in rows(frozenset())}
    needed = dict.fromkeys(row.part_of for row in rows(wanted) if row.name not in always)
    if "hardware" in listed:  # a real robot has sensors of its own
        needed.pop("sensors", None)
    crowd = raw.get(CROWD)
    walkers = ("walkers", "reactive")
    walked = isinstance(crowd, dict) and any(crowd.get(name) for name in walkers)
    if walked or ("skeleton" in wanted and len(_tables(raw.get("robots"))) > 1):
        needed[CROWD] = None
    raw["services"] = [*listed, *(name for name in needed if name not in listed)]


def _own_sections(raw: dict[str, Any], origin: _Origin) -> dict[str, type[Section]]:
    """Return the types of the sections that user nodes define, by node name."""
    given = raw.get("programs")
    tables = given if isinstance(given, dict) else {}
    programs = {name: program for name, program in tables.items() if isinstance(program, str)}
    found: dict[str, type[Section]] = {}
    for name, program in programs.items():
        try:
            section = getattr(find(name, programs), "SECTION", None)
        except ConfigError:
            if name not in NODES:
                raise
            # a class that replaces a node is needed only in its own process, which refuses it
            _drop_unreadable(name, raw, origin)
            continue
        if section is None:
            continue
        if not name.isidentifier():
            raise ConfigError(
                f"programs: {name!r} has a section, so its name must be letters, digits and _"
            )
        if name in _SECTIONS and not issubclass(section, ours := _SECTIONS[name]):
            raise ConfigError(
                f"{program}: in the place of {name} its SECTION must be a subclass of "
                f"mecazen.config.{ours.__name__}"
            )
        found[name] = section
    return found


def _drop_unreadable(name: str, raw: dict[str, Any], origin: _Origin) -> None:
    """Use the defaults if only a program that is missing here can read the section `name`."""
    for table in (raw, *_tables(raw.get("robots"))):
        try:
            _convert(table.get(name, {}), _SECTIONS.get(name, Section), name, origin)
        except ConfigError:
            del table[name]


def _tables(value: Any) -> list[dict[str, Any]]:
    """Return the tables in a list; other values are refused when the list is converted."""
    return [table for table in value if isinstance(table, dict)] if isinstance(value, list) else []


def _complete(robot: dict[str, Any], everyone: dict[str, Any], origin: _Origin) -> None:
    """Read the robot file of one robot's table; its sections override those for `everyone`."""
    if (file := _read_part("robot", robot, origin)) is not None:
        _convert(robot["robot"], Robot, "", _Origin(file[0]))
    for name in robot.keys() - {"name", "robot", "start"}:
        robot[name] = _laid_over(everyone.get(name, {}), robot[name])


def _laid_over(below: Any, above: Any) -> Any:
    """Return tables with the values of `above` over those of `below`; another `kind` replaces."""
    if not isinstance(below, dict) or not isinstance(above, dict):
        return above
    if above.get("kind", below.get("kind")) != below.get("kind"):
        return above
    return below | {key: _laid_over(below.get(key), value) for key, value in above.items()}


def load_bus(path: Path, settings: Mapping[str, Any] = {}) -> BusConfig:
    """Load only the section `[bus]`: no service's code is imported.

    Raises:
        ConfigError: One line with the file, the key and the allowed values.
    """
    raw = {"bus": read_toml(path).get("bus", {})}
    settings = _plain(settings)
    for key, value in settings.items():
        if key.partition(".")[0] == "bus":
            _override(raw, key, value)
    origin = _Origin(path, settings=tuple(settings), given=_strings(list(settings.values())))
    return _convert(raw["bus"], BusConfig, "bus", origin)


def load_table(
    path: Path, kind: type[SectionT], prepare: Callable[[dict[str, Any]], object] = lambda _: None
) -> SectionT:
    """Load a TOML file other than a scenario, with the same checks; `prepare` may change it first.

    Raises:
        ConfigError: One line with the file, the key and the allowed values.
    """
    prepare(raw := read_toml(path))
    return _convert(raw, kind, "", _Origin(path))


def effective(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as plain tables that load to the same scenario again."""
    tables = msgspec.to_builtins(scenario, enc_hook=str)
    for name in NO_KEYS:
        del tables[name]
    return cast(dict[str, Any], _without_none(tables))


def to_toml(scenario: Scenario) -> str:
    """Return `effective` as TOML."""
    return tomli_w.dumps(effective(scenario))


def robots_in(text: str) -> tuple[str, ...]:
    """Return `Scenario.names` of a scenario in TOML; for invalid TOML, those of a single robot."""
    robots = _tables(_parsed(text).get("robots"))
    return tuple(str(robot.get("name")) for robot in robots) or ("",)


def _parsed(text: str) -> dict[str, Any]:
    """Return the tables of a recorded or published scenario; none for invalid TOML."""
    try:
        return parse_toml(text)
    except ValueError:
        return {}


def renamed_in(scenario: str | Mapping[str, Any]) -> dict[str, str]:
    """Return `Scenario.renamed` of a scenario in TOML, or of its tables."""
    tables = _parsed(scenario) if isinstance(scenario, str) else scenario
    renamed: dict[str, str] = {}
    for robot in _tables(tables.get("robots")) or [{}]:
        values = [one.get("controller") for one in (robot, tables)]
        own, shared = (one if isinstance(one, dict) else {} for one in values)
        renamed |= keys.renamed(
            str(robot.get("name", "")),
            command_key=str({**shared, **own}.get("command_key", keys.CMD_VEL.key)),
            odometry_key=str({**shared, **own}.get("odometry_key", keys.ODOM.key)),
        )
    return renamed


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value


def _plain(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings with values as in TOML: paths as strings, NumPy's numbers as Python's."""

    def plain(value: Any) -> Any:
        if isinstance(value, PathLike):
            return fspath(value)
        if isinstance(value, Integral):
            return int(value)
        if isinstance(value, Real):
            return float(value)
        raise TypeError

    tables = {}
    for key, value in settings.items():
        try:
            tables[key] = msgspec.to_builtins(value, enc_hook=plain)
        except (TypeError, ValueError, RecursionError):
            raise ConfigError(
                one_line(f"{key}: got {show(value)}; TOML has no such value")
            ) from None
    return tables


def _parse_override(override: str) -> tuple[str, Any]:
    key, equals, text = override.partition("=")
    key = key.strip()
    if not equals or not re.fullmatch(r"[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)*", key):
        raise ConfigError(one_line(f"--set {override}: must be key.path=value"))
    try:
        return key, parse_value(text)
    except ConfigError as error:
        raise ConfigError(f"--set {key}: {error}") from None


def _strings(value: Any) -> tuple[str, ...]:
    """Return the strings in a value of TOML."""
    if isinstance(value, dict | list):
        each = value.values() if isinstance(value, dict) else value
        return tuple(text for part in each for text in _strings(part))
    return (value,) if isinstance(value, str) else ()


def _override(raw: dict[str, Any], key: str, value: Any) -> None:
    *tables, last = names = key.split(".")
    for depth, name in enumerate(tables):
        table, here = raw.setdefault(name, {}), ".".join(tables[: depth + 1])
        if isinstance(table, list):
            # a key addresses one of several robots by its name
            table = {str(part["name"]): part for part in _tables(table) if "name" in part} or None
            if table and names[depth + 1] not in table:
                raise ConfigError(f"--set {key}: {here} are {', '.join(table)}")
        if not isinstance(table, dict):
            raise ConfigError(f"--set {key}: {here} is not a table")
        raw = table
    if _is_kind(key) and (fields := fields_of_choice(Scenario, tables, value)):
        for name in raw.keys() - fields:
            del raw[name]
    raw[last] = value


def _is_kind(key: str) -> bool:
    """Return whether a key selects one of several kinds of a table."""
    return key.rpartition(".")[2] == "kind"


class _Origin(NamedTuple):
    """The origin of a scenario's values, for error messages."""

    path: Path
    files: Mapping[str, Path] = {}
    """Files of the sections `robot` and `world`, if they come from files."""
    settings: tuple[str, ...] = ()
    """The keys that are overridden."""
    given: tuple[str, ...] = ()
    """Strings of the overrides, compared by identity, since the file may contain equal strings."""
    changes: tuple[str, ...] = ()
    """Keys of these files that the scenario changes."""
    opens_files: bool = True
    """Whether settings may be paths."""

    def locate(self, path: str) -> Path:
        """Return a path relative to the file, or for an override to the working directory."""
        is_given = any(path is text for text in self.given)
        return (Path.cwd() if is_given else self.path.parent) / path

    def name(self, key: str, problem: str, of_table: bool) -> str:
        """Return the file of `key`, and the override that it may come from."""
        is_changed = any(f"{key}.".startswith(f"{change}.") for change in self.changes)
        own = self.files.get(key.partition(".")[0])
        file = self.path if own is None or is_changed else own
        for setting in self.settings:
            within = key == setting or key.startswith(f"{setting}.")
            around = setting.startswith(f"{key}.") if key else True
            # a problem with a whole table names the keys that matter
            if within or (around and (not of_table or setting.rpartition(".")[2] in problem)):
                return f"{file} with --set {setting}"
        return str(file)


def _convert(raw: Any, kind: type[SectionT], prefix: str, origin: _Origin) -> SectionT:
    def to_path(wanted: type, value: Any) -> Path:
        if wanted not in {Path, Folder, Output} or not isinstance(value, str) or not value:
            raise ValueError(f"got {show(value)}")
        if not origin.opens_files and wanted is not Output:
            raise UntrustedError(f"{origin.path}: would open the file {printable(value)}")
        found = origin.locate(value).resolve()
        if wanted is not Output and not (found.is_dir() if wanted is Folder else found.is_file()):
            raise ValueError(f"{found}: no such {'folder' if wanted is Folder else 'file'}")
        return wanted(found)

    try:
        return msgspec.convert(raw, kind, dec_hook=to_path)
    except msgspec.ValidationError as error:
        raise ConfigError(explain(error, raw, kind, prefix, origin.name)) from None
