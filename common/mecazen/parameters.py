"""Parameters: the settings of a scenario that may change while a simulation runs.

Parameters are the fields declared as `mecazen.schema.Live`. A change is a setting as with `--set`,
by its key and in TOML, with the same ranges.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

import msgspec
import msgspec.inspect as mi

from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.explain import describe, one_line, show
from mecazen.files import parse_value, to_value
from mecazen.graph import SERVICES
from mecazen.messages import Parameter, ParameterDescriptor, Parameters
from mecazen.schema import LIVE, Section, SectionT

ROBOTS = "robots"
"""First part of the keys of one robot's parameters; the robot's name is the second part."""

UNITS = {
    "m": "m",
    "s": "s",
    "deg": "°",
    "hz": "Hz",
    "m_s": "m/s",
    "m_s2": "m/s²",
    "m_s3": "m/s³",
    "rad_s": "rad/s",
    "rad_s2": "rad/s²",
    "rad_s3": "rad/s³",
    "1_s": "1/s",
}
"""Units by the last part of a parameter's name."""

Path = tuple[str, ...]


class Live(NamedTuple):
    """A parameter of a scenario."""

    value: Any
    kind: mi.Type


def parameters(scenario: Scenario) -> dict[str, Live]:
    """Return the parameters of the services that take part, by their keys.

    With several robots, each robot also has its own parameters: `robots.two.follower.standoff_m`.
    """
    found = _of_services(scenario)
    for robot in scenario.robots:
        own = _of_services(scenario.of(robot.name))
        found |= {
            f"{ROBOTS}.{robot.name}.{key}": live
            for key, live in own.items()
            if key.partition(".")[0] in robot.__struct_fields__
        }
    return found


def _of_services(scenario: Scenario) -> dict[str, Live]:
    return {
        f"{name}.{'.'.join(path)}": live
        for name in scenario.services
        if isinstance(section := getattr(scenario, name, None), Section)
        for path, live in _within(section)
    }


def _within(section: Section) -> Iterator[tuple[Path, Live]]:
    for name, kind in _kinds(type(section)).items():
        value = getattr(section, name)
        if isinstance(kind, mi.Metadata) and (kind.extra or {}).get(LIVE):
            yield (name,), Live(value, kind.type)
        elif isinstance(value, Section):
            yield from (((name, *path), live) for path, live in _within(value))


@cache
def _kinds(kind: type[Section]) -> dict[str, mi.Type]:
    info = mi.type_info(kind)
    assert isinstance(info, mi.StructType)
    return {field.name: field.type for field in info.fields}


def described(name: str, live: Live) -> ParameterDescriptor:
    """Return a parameter as a message."""
    parts = name.rpartition(".")[2].split("_")
    ends = ("_".join(parts[first:]) for first in range(1, len(parts)))
    kind = _some(live.kind)
    bounds = (getattr(kind, "ge", None), getattr(kind, "gt", None)), (getattr(kind, "le", None),)
    known = tuple(next((b for b in of if b is not None), None) for of in bounds)
    types = {mi.BoolType: "bool", mi.IntType: "integer", mi.FloatType: "float"}
    is_list = isinstance(kind, mi.VarTupleType | mi.TupleType)
    return ParameterDescriptor(
        name=name,
        value=to_text(live.value),
        type=types.get(type(kind), "list" if is_list else "string"),
        unit=next((UNITS[end] for end in ends if end in UNITS), ""),
        range=() if None in known else tuple(map(float, known)),  # type: ignore[arg-type]
        allowed=describe(live.kind) + (", or left out" if _is_optional(live.kind) else ""),
    )


def _some(kind: mi.Type) -> mi.Type:
    """Return the type of a given value of a setting that may be left out."""
    kind = kind.type if isinstance(kind, mi.Metadata) else kind
    if isinstance(kind, mi.UnionType):
        (kind,) = (t for t in kind.types if not isinstance(t, mi.NoneType))
    return kind.type if isinstance(kind, mi.Metadata) else kind


def _is_optional(kind: mi.Type) -> bool:
    kind = kind.type if isinstance(kind, mi.Metadata) else kind
    return isinstance(kind, mi.UnionType)


def to_text(value: Any) -> str:
    """Return a value in TOML, or "" if it is left out."""
    return "" if value is None else to_value(value)


def settings_of(message: Parameters) -> dict[str, str]:
    """Return the values of a message by their keys, the last one last."""
    settings: dict[str, str] = {}
    for parameter in message.parameters:
        settings.pop(parameter.name, None)
        settings[parameter.name] = parameter.value
    return settings


def to_message(settings: Mapping[str, str]) -> tuple[Parameter, ...]:
    """Return settings as parameters of a message: the inverse of `settings_of`."""
    return tuple(Parameter(name=name, value=value) for name, value in settings.items())


def refuse_unknown(scenario: Scenario, settings: Mapping[str, str]) -> None:
    """Refuse settings that are no parameters.

    Raises:
        ConfigError: A setting is no parameter; the message has a suggestion.
    """
    known = parameters(scenario)
    for key in settings:
        if key in known:
            continue
        close = difflib.get_close_matches(key, known, n=1)
        section = key.partition(".")[0]
        if section in SERVICES and section not in scenario.services:
            problem = f"{section} takes no part in this scenario"
        elif _is_setting(scenario, key):
            problem = "can't change while it runs: its value at the start counts"
        else:
            problem = "no such parameter; "
            problem += f"did you mean {close[0]}?" if close else "`mecazen param list` shows all"
        raise ConfigError(one_line(f"{key}: {problem}"))


def _is_setting(scenario: Scenario, key: str) -> bool:
    """Return whether the configuration has a key."""
    value: Any = scenario
    for name in key.split("."):
        if not isinstance(value, Section) or name not in type(value).__struct_fields__:
            return False
        value = getattr(value, name)
    return value is not None


def changed(scenario: Scenario, settings: Mapping[str, str]) -> Scenario:
    """Return a scenario with changed parameters; a key without a robot's name is for all robots.

    Raises:
        ConfigError: A value, or the scenario with it, is not allowed.
    """
    tree: dict[str, Any] = {}
    trees: dict[str, dict[str, Any]] = {robot.name: {} for robot in scenario.robots}
    own = {(robot.name, name) for robot in scenario.robots for name in robot.own}
    for key, text in settings.items():
        path = key.split(".")
        if path[0] == ROBOTS and len(path) > 3 and path[1] in trees:
            _put(trees[path[1]], path[2:], text)
            own.add((path[1], path[2]))
        else:
            for to in (tree, *trees.values()):
                _put(to, path, text)
    robots = []
    for robot in scenario.robots:
        part, prefix = scenario.of(robot.name), f"{ROBOTS}.{robot.name}."
        mine = {name: of for name, of in trees[robot.name].items() if (robot.name, name) in own}
        robots.append(msgspec.structs.replace(robot, **_changed(part, mine, prefix)))
    return _replaced(scenario, _changed(scenario, tree) | {ROBOTS: tuple(robots)}, "")


def _put(tree: dict[str, Any], path: list[str], text: str) -> None:
    for name in path[:-1]:
        below = tree.setdefault(name, {})
        tree = below if isinstance(below, dict) else {}
    tree[path[-1]] = text


def _changed(scenario: Scenario, tree: Mapping[str, Any], prefix: str = "") -> dict[str, Section]:
    """Return the changed sections of a scenario, or of one robot's part of a scenario."""
    return {
        name: _with(getattr(scenario, name, None), changes, prefix + name)
        for name, changes in tree.items()
    }


def _with(section: Section | None, changes: Any, key: str) -> Section:
    fields: dict[str, Any] = {}
    if not isinstance(section, Section):
        raise ConfigError(one_line(f"{key}: no such section"))
    kinds = _kinds(type(section))
    for name, change in (changes if isinstance(changes, dict) else {"": changes}).items():
        here, value = f"{key}.{name}", getattr(section, name, None)
        if isinstance(change, dict) and isinstance(value, Section):
            fields[name] = _with(value, change, here)
        elif name in kinds and isinstance(change, str):
            fields[name] = _converted(change, type(section), name, here)
        else:
            raise ConfigError(one_line(f"{here}: no such parameter"))
    return _replaced(section, fields, key)


def _converted(text: str, section: type[Section], name: str, key: str) -> Any:
    kind = _kinds(section)[name]
    if not text and _is_optional(kind):
        return None
    try:
        value = parse_value(text)
    except ConfigError as error:
        raise ConfigError(f"{key}: {error}") from None
    try:
        return msgspec.convert(value, _types(section)[name])
    except msgspec.ValidationError:
        raise ConfigError(
            one_line(f"{key}: got {show(value)}; allowed: {describe(kind)}")
        ) from None


@cache
def _types(section: type[Section]) -> Mapping[str, Any]:
    return {field.name: field.type for field in msgspec.structs.fields(section)}


def _replaced(whole: SectionT, fields: Mapping[str, Any], key: str) -> SectionT:
    """Return a struct with other fields; the struct's own checks run."""
    try:
        return msgspec.structs.replace(whole, **fields)
    except ValueError as error:
        raise ConfigError(one_line(": ".join(filter(None, (key, str(error)))))) from None
