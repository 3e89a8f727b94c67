"""Parameters: the settings of a scenario that may change while a simulation runs.

Parameters are the fields declared as `mecazen.schema.Live`. A change is a setting as with `--set`,
by its key and in TOML, with the same ranges.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import msgspec
import msgspec.inspect as mi

from mecazen.config import Scenario
from mecazen.config.people import Passerby
from mecazen.config.world import Box, Cylinder
from mecazen.errors import ConfigError, is_installed
from mecazen.explain import describe, suggestion
from mecazen.files import parse_value, to_value
from mecazen.graph import CROWD, NODES, SERVICES, SHARED
from mecazen.keys import PARAMETERS
from mecazen.loading import convert, effective, in_toml, override
from mecazen.messages import Parameter, ParameterDescriptor, Parameters
from mecazen.node import Node
from mecazen.programs import classes, find
from mecazen.schema import Section, is_live, members
from mecazen.text import printable
from mecazen.wire import encode

ROBOTS = "robots"
"""First part of the keys of one robot's parameters; the robot's name is the second part."""
ADDED = "world.added."
"""Begin of the keys of boxes and people in the world that were added; their names follow."""
THING: Any = Box | Cylinder | Passerby
MOST_BYTES = PARAMETERS.max_bytes - 256
"""Maximum size of all changes, without the header of their message [bytes]."""

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


class LiveSetting(NamedTuple):
    """A parameter of a scenario."""

    value: Any
    kind: mi.Type


def parameters(scenario: Scenario) -> dict[str, LiveSetting]:
    """Return the parameters of the services that take part, by their keys.

    With several robots, each robot also has its own parameters: `robots.two.follower.standoff_m`.
    So has each addition to the world: `world.added.crate`.
    """
    live = {
        f"{name}.{key}": parameter
        for name in scenario.services
        for key, parameter in _within(getattr(scenario, name, None))
    }
    for robot in scenario.robots:
        part = scenario.of(robot.name)
        live |= {
            f"{ROBOTS}.{robot.name}.{name}.{key}": parameter
            for name in scenario.services
            if name in robot.__struct_fields__
            for key, parameter in _within(getattr(part, name, None))
        }
    return live | {
        ADDED + name: LiveSetting(msgspec.to_builtins(thing), mi.type_info(type(thing)))
        for name, thing in scenario.world.added.items()
    }


def _within(section: object) -> Iterator[tuple[str, LiveSetting]]:
    if not isinstance(section, Section):
        return
    for field in mi.type_info(type(section)).fields:  # type: ignore[attr-defined]
        value = getattr(section, field.name)
        if is_live(field.type):
            yield field.name, LiveSetting(value, field.type)
        else:
            yield from ((f"{field.name}.{key}", live) for key, live in _within(value))


def described(name: str, live: LiveSetting) -> ParameterDescriptor:
    """Return a parameter as a message."""
    parts = name.rpartition(".")[2].split("_")
    ends = ("_".join(parts[first:]) for first in range(1, len(parts)))
    (kind,) = members(live.kind)
    whole = live.kind.type if isinstance(live.kind, mi.Metadata) else live.kind
    types = {mi.BoolType: "bool", mi.IntType: "integer", mi.FloatType: "float"}
    is_list = isinstance(kind, mi.VarTupleType | mi.TupleType)
    bounds: tuple[float, ...] = ()
    if isinstance(kind, mi.IntType | mi.FloatType):
        least = kind.gt if kind.ge is None else kind.ge
        bounds = () if least is None or kind.le is None else (float(least), float(kind.le))
    return ParameterDescriptor(
        name=name,
        value=to_text(live.value),
        type=types.get(type(kind), "list" if is_list else "string"),
        unit=next((UNITS[end] for end in ends if end in UNITS), ""),
        range=bounds,
        allowed=describe(live.kind) + (", or left out" if isinstance(whole, mi.UnionType) else ""),
    )


def to_text(value: Any) -> str:
    """Return a value in TOML, or "" if it is left out."""
    return "" if value is None else to_value(value)


def settings_of(message: Parameters) -> dict[str, Any]:
    """Return the values of a message by their keys, the last one last; None: left out.

    Raises:
        ConfigError: A value is not in TOML.
    """
    settings: dict[str, Any] = {}
    for parameter in message.parameters:
        settings.pop(parameter.name, None)
        try:
            value = parse_value(parameter.value) if parameter.value else None
        except ConfigError as error:
            raise ConfigError(printable(f"{parameter.name}: {error}")) from None
        settings[parameter.name] = value
    return settings


def to_message(settings: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Return settings as parameters of a message: the inverse of `settings_of`."""
    return tuple(Parameter(name=name, value=to_text(value)) for name, value in settings.items())


def refuse_unknown(scenario: Scenario, settings: Iterable[str]) -> None:
    """Refuse settings that are no parameters.

    Raises:
        ConfigError: A setting is no parameter; the message has a suggestion.
    """
    known = parameters(scenario)
    for key in settings:
        if key in known:
            continue
        section = key.partition(".")[0]
        if section in SERVICES and section not in scenario.services:
            problem = f"{section} takes no part in this scenario"
        elif _is_setting(scenario, key):
            problem = "can't change while it runs: its value at the start counts"
        else:
            similar = suggestion(key, known).strip() or "`mecazen param list` shows all"
            problem = f"no such parameter; {similar}"
        raise ConfigError(printable(f"{key}: {problem}"))


def refuse_names(scenario: Scenario, things: Mapping[str, Any]) -> None:
    """Refuse to add what exists, and to remove what was not added to the world of a scenario.

    Raises:
        ConfigError: As above, or a name can't be used, or the world is not simulated.
    """
    added = scenario.world.added
    people = {robot or "target" for robot in scenario.names}
    for key, value in things.items():
        name = key.removeprefix(ADDED)
        if "physics" not in scenario.services:
            problem = "the world of a real robot can't be changed"
        elif value is None and name not in added:
            known = f"added: {', '.join(added)}" if added else "nothing was"
            problem = f"was not added; {suggestion(name, added).strip() or known}"
        elif value is not None and name in added:
            problem = f"exists already; `mecazen world remove {name}` takes it away"
        elif name in people or not re.fullmatch("(?!walker_)[A-Za-z0-9_-]+", name):
            problem = "a name has letters, digits, _ and -, and is no person's of the scenario"
        else:
            continue
        raise ConfigError(printable(f"{name}: {problem}"))


def _is_setting(scenario: Scenario, key: str) -> bool:
    value: Any = scenario
    for name in key.split("."):
        value = getattr(value, name, None) if isinstance(value, Section) else None
    return value is not None


def changed(scenario: Scenario, settings: Mapping[str, Any]) -> Scenario:
    """Return a scenario with changed parameters; a key without a robot's name is for all robots.

    Raises:
        ConfigError: A value, or the scenario with it, is not allowed.
    """
    values: dict[str, Any] = {}
    settings = in_toml(settings)
    for key, value in settings.items():
        if key.startswith(ADDED):
            continue
        section = key.partition(".")[0]
        for robot in scenario.robots:
            of_robot = f"{ROBOTS}.{robot.name}.{key}"
            if section in robot.sections or of_robot in values:
                values[of_robot] = value
        values[key] = value
    tables, types = effective(scenario), mi.type_info(type(scenario))
    for key, value in values.items():
        override(tables, types, key, value)
    return with_added(convert(tables, type(scenario), ""), settings)


def with_added(scenario: Scenario, settings: Mapping[str, Any]) -> Scenario:
    """Return a scenario with the settings of things in its world; None removes a thing.

    Raises:
        ConfigError: A value is not allowed, or no node simulates the people.
    """
    added = dict(scenario.world.added)
    for key, value in settings.items():
        if key.startswith(ADDED):
            name = key.removeprefix(ADDED)
            added.pop(name, None)
            if value is not None:
                added[name] = convert(value, THING, "", prefix=key)
    world = msgspec.structs.replace(scenario.world, added=added)
    if world.passersby and CROWD not in scenario.services:
        services = to_value((*scenario.services, CROWD))
        raise ConfigError(f"people need the crowd: start with --set 'services={services}'")
    return msgspec.structs.replace(scenario, world=world)


class LiveParameters:
    """The parameters of a simulation, which stay in effect for the runs that follow.

    Additions to the world stay until the end of the run. `check_world` raises ConfigError if a
    scenario does not suit the robots now.
    """

    def __init__(self, scenario: Scenario, check_world: Callable[[Scenario], None]) -> None:
        self._start = scenario
        self._check_world = check_world
        self.scenario = self.requested = scenario
        """The scenario that applies now, and the one from the next tick on."""
        self.settings: dict[str, Any] = {}
        """Changed parameters: values by key, in the order of the changes."""
        self._requested: dict[str, Any] = {}

    def set(self, settings: Mapping[str, Any]) -> None:
        """Change parameters from the next tick on.

        Raises:
            ConfigError: A parameter is not live or a value is invalid; then nothing changes.
        """
        settings = in_toml(settings)
        things = {key: value for key, value in settings.items() if key.startswith(ADDED)}
        fields = settings.keys() - things.keys()
        refuse_unknown(self._start, fields)
        refuse_names(self.requested, things)
        unchanged = {k: v for k, v in self._requested.items() if k not in settings}
        requested = {**unchanged, **settings}
        scenario = changed(self._start, requested)
        if len(encode(Parameters(parameters=to_message(requested)))) > MOST_BYTES:
            raise ConfigError("too many changes in one run; a reset undoes those of the world")
        for name in {part for key in fields for part in key.split(".")}:
            if name in scenario.services:
                refuse_unsuitable(scenario, name)
        if things:
            self._check_world(scenario)
        self.requested, self._requested = scenario, requested

    def begin(self) -> None:
        """Begin a run: its world is that of the scenario again, from the first tick on."""
        kept = {key: v for key, v in self._requested.items() if not key.startswith(ADDED)}
        if kept != self._requested:
            self.requested, self._requested = changed(self._start, kept), kept

    def apply(self) -> bool:
        """Apply what has been set since the last tick; return whether a value differs."""
        if self._requested == self.settings:
            return False
        self.settings, self.scenario = self._requested, self.requested
        return True


def refuse_unsuitable(scenario: Scenario, service: str) -> None:
    """Refuse changed settings that a node of a service rejects; accept them if none is installed.

    Raises:
        ConfigError: The node's constructor rejects them, or a user's class does not read them.
    """
    try:
        kinds = classes(service, scenario)
    except ConfigError:
        return
    program = scenario.programs.get(service)
    if program and service in NODES and is_installed(service):
        kind = kinds[service]
        if getattr(kind, "SECTION", None) is None and not issubclass(kind, find(service, {})):
            raise ConfigError(
                f"{service}: no effect on {program}, which takes its place; if it reads "
                f"scenario.{service}, let it name the type as its SECTION"
            )
    for part in (scenario,) if service in SHARED else map(scenario.of, scenario.names):
        for kind in kinds.values():
            if issubclass(kind, Node):
                kind(part)
