"""Scenarios from TOML files: strict about keys, types and ranges, with overrides."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from os.path import normpath
from pathlib import Path
from typing import Any, cast

import msgspec
import msgspec.inspect as mi
import tomli_w

from mecazen.config import BusConfig, Scenario, WorldConfig
from mecazen.config.scenario import scenario_with
from mecazen.errors import ConfigError, UntrustedError
from mecazen.explain import explain, show, suggestion
from mecazen.files import parse_toml, parse_value, plain, read_toml
from mecazen.robot import Robot
from mecazen.schema import (
    NO_KEYS,
    PROGRAM,
    Folder,
    OutputFile,
    Section,
    SectionT,
    below,
    choose,
    fields,
    members,
)
from mecazen.text import printable

OWN = Path(__file__).parent
"""Folder of the package; its `configs` holds the scenarios, robots and worlds of the package."""
SCENARIO_VARIABLE, SETTINGS_VARIABLE = "MECAZEN_SCENARIO", "MECAZEN_SET"
"""Environment variables with a scenario and its overrides (separated by spaces), used if no
scenario and no overrides are given."""
_SECTIONS: dict[str, Any] = {field.name: field.type for field in msgspec.structs.fields(Scenario)}
"""The types of a scenario's fields."""
_PARTS: dict[str, type[Section]] = {"robot": Robot, "world": WorldConfig}
"""Sections that may come from a file."""
_NAME = r"[\w-]+"
"""The pattern of the name of a provided file; everything else is a path."""


def scenario_path(name: str) -> Path:
    """Return the file of a scenario given by its path or by its name in `configs/scenarios`.

    Raises:
        ConfigError: There is no such file.
    """
    return given_file(name, "scenario")


def given_file(name: str, kind: str) -> Path:
    """Return a TOML file given on the command line by its path or as in `named_file`.

    Raises:
        ConfigError: There is no such file.
    """
    path = Path(name)
    return path if path.is_file() else named_file(name, kind)


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
    shown = printable(name) or "''"
    raise ConfigError(
        f"{where}{shown}: no such {'file' if name.endswith('.toml') else kind}; "
        f"{suggestion(name, known)}a path to a TOML file, or one of {', '.join(known)}"
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
    settings = {}
    for override in overrides:
        key, equals, text = override.partition("=")
        key = key.strip()
        if not equals or not re.fullmatch(r"[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)*", key):
            raise ConfigError(printable(f"--set {override}: must be key.path=value"))
        try:
            settings[key] = parse_value(text)
        except ConfigError as error:
            raise ConfigError(f"--set {key}: {error}") from None
    return settings


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
    for name in NO_KEYS:
        if name in raw:
            raise ConfigError(f"{path}: unknown key '{name}'")
    settings, folder = in_toml(settings), path.parent.resolve()
    # programs come first, since their sections are part of the scenario's type
    first = [key for key in settings if key.partition(".")[0] == "programs"]
    raw = _with_paths(mi.type_info(Scenario), raw, folder)
    for key in first:
        override(raw, mi.type_info(Scenario), key, settings[key])
    sections, unreadable = _take_programs(raw, path)
    kind = scenario_with(**sections)
    types = mi.type_info(kind)
    raw = _with_paths(types, raw, folder)
    # a whole part comes before its keys, and a kind before the keys of that kind
    for key in sorted(settings, key=lambda key: (key not in _PARTS, key.split(".")[-1] != "kind")):
        if key not in first:
            override(raw, types, key, settings[key])
    robots = _tables(raw.get("robots"))
    for name in unreadable:
        _drop_unreadable(name, (raw, *robots))
    for table in (raw, *robots):
        for part in _PARTS:
            _read_part(part, table, path, settings, opens_files=opens_files)
    for robot in robots:
        for name in robot.keys() - {"name", "robot", "start"}:
            robot[name] = _laid_over(raw.get(name, {}), robot[name])
    return convert(raw, kind, path, settings, opens_files=opens_files)


def in_toml(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings with values as in TOML.

    Raises:
        ConfigError: TOML has no such value.
    """
    tables = {}
    for key, value in settings.items():
        try:
            tables[key] = msgspec.to_builtins(value, enc_hook=plain)
        except (TypeError, ValueError, RecursionError):
            text = f"{key}: got {show(value)}; TOML has no such value"
            raise ConfigError(printable(text)) from None
    return tables


def _with_paths(node: mi.Type, value: Any, folder: Path) -> Any:
    """Return a value of TOML whose relative paths are joined to a folder."""
    for kind in members(node):
        if isinstance(kind, mi.StructType) and kind.cls in _PARTS.values():
            table = {"file": value} if isinstance(value, str) else value
            name = table.get("file") if isinstance(table, dict) else None
            if isinstance(name, str) and not re.fullmatch(_NAME, name):
                table = table | {"file": normpath(folder / name)}
            value = table
        is_program = isinstance(kind, mi.StrType) and kind.pattern == PROGRAM
        is_path = isinstance(kind, mi.CustomType) or (is_program and ".py:" in str(value))
        if isinstance(value, dict):
            value = {
                key: _with_paths(below(kind, key), item, folder) for key, item in value.items()
            }
        elif isinstance(value, list):
            value = [_with_paths(below(kind, str(i)), item, folder) for i, item in enumerate(value)]
        elif is_path and isinstance(value, str) and value:
            value = normpath(folder / value)
    return value


def _read_part(
    part: str, table: dict[str, Any], path: Path, settings: Iterable[str], *, opens_files: bool
) -> None:
    """Read the file of a robot or a world that a table names, and lay the table's values over it.

    The file is a path, or the name of a provided file: `{ file = "nexus", payload = { … } }`.
    """
    value = table.get(part)
    if not isinstance(value, dict):
        return
    if not opens_files and value.keys() & {"file", "map"}:
        raise UntrustedError(f"{path}: {part} would be read from another file")
    name = value.pop("file", None)
    if isinstance(name, str):
        where = f"{_origin(path, settings, part, '')}: {part}: "
        file = named_file(name, part, where) if re.fullmatch(_NAME, name) else Path(name)
        kind = _PARTS[part]
        below = _with_paths(mi.type_info(kind), read_toml(file), file.parent)
        _take_map(below)
        convert(dict(below), kind, file)
        table[part] = value = _laid_over(below, value)
    _take_map(value)


def _take_map(world: dict[str, Any]) -> None:
    """Add the boxes of the occupancy map that a world names to its obstacles.

    Wrong types are refused when the table is converted.
    """
    name, obstacles = world.get("map"), world.get("obstacles", [])
    if isinstance(name, str) and name and isinstance(obstacles, list):
        from mecazen.occupancy import read_map  # noqa: PLC0415  # only worlds with a map need it

        del world["map"]
        world["obstacles"] = [*obstacles, *read_map(Path(name))]


def _take_programs(raw: dict[str, Any], path: Path) -> tuple[dict[str, type[Section]], list[str]]:
    """Check the names of user programs.

    Return the types of the sections that user programs define, by node name, and the names of the
    nodes whose program can't be imported here.
    """
    table = raw.get("programs")
    if not isinstance(table, dict) or not table:
        return {}, []
    from mecazen.graph import COLLECTOR, NODES  # noqa: PLC0415  # loading is light without programs
    from mecazen.programs import find  # noqa: PLC0415

    reserved = {"router", "clock", COLLECTOR, "guard"} | (_SECTIONS.keys() - NODES.keys())
    for name in table:
        if name in reserved or not re.fullmatch("[A-Za-z0-9_-]+", name):
            raise ConfigError(
                f"{path}: programs: {name!r} can't be a node's name; a name of its own, of "
                "letters, digits, _ and -, can"
            )
    sections: dict[str, type[Section]] = {}
    unreadable = []
    programs = {name: program for name, program in table.items() if isinstance(program, str)}
    for name, program in programs.items():
        try:
            section = getattr(find(name, programs), "SECTION", None)
        except ConfigError:
            if name not in NODES:
                raise
            # a class that replaces a node is needed only in its own process, which refuses it
            unreadable.append(name)
            continue
        if section is None:
            continue
        if not name.isidentifier():
            raise ConfigError(
                f"programs: {name!r} has a section, so its name must be letters, digits and _"
            )
        if name in _SECTIONS and not issubclass(section, replaced := _SECTIONS[name]):
            raise ConfigError(
                f"{program}: in the place of {name} its SECTION must be a subclass of "
                f"mecazen.config.{replaced.__name__}"
            )
        sections[name] = section
    return sections, unreadable


def _drop_unreadable(name: str, tables: Iterable[dict[str, Any]]) -> None:
    """Use the defaults if only a program that is missing here can read the section `name`."""
    for table in tables:
        try:
            convert(table.get(name, {}), _SECTIONS.get(name, Section), "")
        except ConfigError:
            del table[name]


def _tables(value: Any) -> list[dict[str, Any]]:
    """Return the tables in a list; other values are refused when the list is converted."""
    return [table for table in value if isinstance(table, dict)] if isinstance(value, list) else []


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
    tables = {"bus": read_toml(path).get("bus", {})}
    types = mi.type_info(Scenario)
    tables = _with_paths(types, tables, path.parent.resolve())
    settings = in_toml(settings)
    for key, value in settings.items():
        if key.partition(".")[0] == "bus":
            override(tables, types, key, value)
    return convert(tables["bus"], BusConfig, path, settings, prefix="bus")


def load_table(
    path: Path, kind: type[SectionT], prepare: Callable[[dict[str, Any]], object] = lambda _: None
) -> SectionT:
    """Load a TOML file other than a scenario, with the same checks; `prepare` may change it first.

    Raises:
        ConfigError: One line with the file, the key and the allowed values.
    """
    prepare(raw := read_toml(path))
    return convert(_with_paths(mi.type_info(kind), raw, path.parent.resolve()), kind, path)


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
    robots = _tables(tables_in(text).get("robots"))
    return tuple(str(robot.get("name")) for robot in robots) or ("",)


def tables_in(text: str) -> dict[str, Any]:
    """Return the tables of a recorded or published scenario; none for invalid TOML."""
    try:
        return parse_toml(text)
    except ValueError:
        return {}


def renamed_in(text: str) -> dict[str, str]:
    """Return `Scenario.renamed` of a scenario in TOML."""
    tables = tables_in(text)
    from mecazen import keys  # noqa: PLC0415  # loading is light without messages

    renamed: dict[str, str] = {}
    for robot in _tables(tables.get("robots")) or [{}]:
        controller: dict[str, Any] = {}
        for table in (tables, robot):
            section = table.get("controller")
            controller |= section if isinstance(section, dict) else {}
        renamed |= keys.renamed(
            str(robot.get("name", "")),
            str(controller.get("command_key", keys.CMD_VEL.key)),
            str(controller.get("odometry_key", keys.ODOM.key)),
        )
    return renamed


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value


def override(raw: dict[str, Any], node: mi.Type, key: str, value: Any) -> None:
    """Put a value into tables of a type; a path is relative to the working directory.

    Another `kind` drops the keys that it does not have.

    Raises:
        ConfigError: The key leads into a value, or names no robot.
    """
    *tables, last = names = key.split(".")
    for depth, name in enumerate(tables):
        node = below(choose(node, raw), name)
        table, whole = raw.setdefault(name, {}), ".".join(tables[: depth + 1])
        if isinstance(table, list):
            # a key addresses one of several robots by its name
            table = {str(robot["name"]): robot for robot in _tables(table) if "name" in robot}
            if table and names[depth + 1] not in table:
                raise ConfigError(f"{key}: {whole} are {', '.join(table)}")
            table = table or None
        if not isinstance(table, dict):
            raise ConfigError(f"{key}: {whole} is not a table")
        raw = table
    if last == "kind":
        for choice in members(node):
            if isinstance(choice, mi.StructType) and choice.tag == value:
                for name in raw.keys() - fields(choice).keys():
                    del raw[name]
    raw[last] = _with_paths(below(choose(node, raw), last), value, Path.cwd())


def convert(
    raw: Any,
    kind: type[SectionT],
    path: Path | str,
    settings: Iterable[str] = (),
    *,
    prefix: str = "",
    opens_files: bool = True,
) -> SectionT:
    """Convert tables to a struct.

    Args:
        raw: The tables; paths are absolute.
        kind: The struct.
        path: The file that the tables come from.
        settings: The keys of the settings that replaced values of the file.
        prefix: The key of the tables in the file.
        opens_files: Whether values may be paths of files to read.

    Raises:
        ConfigError: One line with the file, the key and the allowed values.
        UntrustedError: A value is such a path, and `opens_files` is false.
    """

    def to_path(wanted: type, value: Any) -> Path:
        if wanted not in {Path, Folder, OutputFile} or not isinstance(value, str) or not value:
            raise ValueError(f"got {show(value)}; allowed: a path")
        if not opens_files and wanted is not OutputFile:
            raise UntrustedError(f"{path}: would open the file {printable(value)}")
        file = Path(value).resolve()
        if wanted is not OutputFile and not (file.is_dir() if wanted is Folder else file.is_file()):
            raise ValueError(f"{file}: no such {'folder' if wanted is Folder else 'file'}")
        return wanted(file)

    try:
        return msgspec.convert(raw, kind, dec_hook=to_path)
    except msgspec.ValidationError as error:
        key, problem = explain(error, raw, kind, prefix)
        origin = _origin(path, settings, key, problem)
        parts = (origin, "" if origin.endswith(f" with {key}") else key, problem)
        raise ConfigError(printable(": ".join(filter(None, parts)))) from None


def _origin(path: Path | str, settings: Iterable[str], key: str, problem: str) -> str:
    """Return the file of a key, and the setting that its value may come from."""
    for setting in settings:
        within = f"{key}.".startswith(f"{setting}.")
        # the problem of a whole table names the keys that matter
        names_it = problem.startswith("got ") or setting.rpartition(".")[2] in problem
        if within or (names_it and (not key or setting.startswith(f"{key}."))):
            return f"{path} with {setting}"
    return str(path)
