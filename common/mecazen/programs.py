"""Finds the classes of the nodes of a scenario, and the graph of these nodes."""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from mecazen import graph
from mecazen.config import Scenario
from mecazen.errors import ConfigError, explained
from mecazen.extras import is_installed
from mecazen.graph import Graph
from mecazen.keys import CALLS, CMD_VEL, GUARD_CMD_VEL, JOINT_COMMAND, ODOM, TOPICS, Call, Topic
from mecazen.node import Computing, Node, World
from mecazen.plan import compile_plan
from mecazen.row import Row
from mecazen.runtime.observer import Observer
from mecazen.schema import Section

Kind = type[Node] | type[World] | type[Observer]


def find(name: str, programs: Mapping[str, str]) -> Kind:
    """Return the class of a node: by its name or `file.py:Class`, or of the program in its place.

    Raises:
        ConfigError: There is no such class, or its extra is not installed.
    """
    program = programs.get(name, name)
    if program in graph.TABLE and (row := graph.TABLE[program]).program:
        if not is_installed(row.part_of):
            raise ConfigError(f"{name} is not installed: pip install 'mecazen[{row.part_of}]'")
        return _class_of(row.program)
    if ":" not in program:
        if program.endswith(".py"):
            raise ConfigError(f"{program}: add the class, such as {program}:MyFollower")
        nodes = ", ".join(sorted(row.name for row in graph.GRAPH if row.program))
        raise ConfigError(f"{program}: no such node; nodes: {nodes}; or file.py:Class of your own")
    return _class_of(program)


def imported(program: str) -> object:
    """Return the object that `file.py:Name` or `module:Name` names; None: there is no such name.

    Raises:
        ConfigError: The file or module can't be imported.
    """
    place, _, attribute = program.partition(":")
    return getattr(_import(place), attribute, None)


def _class_of(program: str) -> Kind:
    """Return the class that `file.py:Class` or `module:Class` names.

    Raises:
        ConfigError: The class does not exist, or it is no node.
    """
    found = imported(program)
    place, _, name = program.partition(":")
    if found is None:
        close = difflib.get_close_matches(name, dir(_import(place)), n=1)
        raise ConfigError(
            f"{program}: no such class in {place}{f'; did you mean {close[0]}?' if close else ''}"
        )
    return _checked(found, program)


def _import(place: str) -> ModuleType:
    is_file = place.endswith(".py")
    if not is_file and not all(part.isidentifier() for part in place.split(".")):
        raise ConfigError(f"{place or repr(place)}: neither file.py nor a module's name")
    if is_file and (Path(place).is_fifo() or Path(place).is_char_device()):  # without an end
        raise ConfigError(f"{place}: must be a regular file, not a device or a pipe")
    try:
        return _from_file(place) if is_file else importlib.import_module(place)
    except (ImportError, OSError, SyntaxError) as error:
        raise ConfigError(f"{place}: can't be imported: {error}") from None
    except Exception as error:
        raise ConfigError(f"{place}: can't be imported: {explained(error)}") from error


def _from_file(place: str) -> ModuleType:
    if place not in _loaded:
        spec = importlib.util.spec_from_file_location(Path(place).stem, place)
        assert spec is not None  # as for every name that ends in .py
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        _loaded[place] = module
    return _loaded[place]


_loaded: dict[str, ModuleType] = {}
"""Loaded files of user programs, by path: nodes of one file share its topics and messages."""


def _checked(found: object, program: str) -> Kind:
    if not (isinstance(found, type) and issubclass(found, Node | World | Observer)):
        raise ConfigError(f"{program}: not a subclass of mecazen.node.Node")
    if issubclass(found, Computing) and not isinstance(getattr(found, "ROW", None), Row):
        raise ConfigError(f"{program}: needs ROW, its row of the graph")
    section = getattr(found, "SECTION", None)
    if section is not None and not (isinstance(section, type) and issubclass(section, Section)):
        raise ConfigError(f"{program}: SECTION must be a subclass of mecazen.schema.Section")
    return found


def reads_section(service: str, kinds: Mapping[str, Kind]) -> bool:
    """Return whether a service reads its section, given its classes by node name.

    A user class reads it if the class has a SECTION or derives from the class that it replaces.
    """
    kind = kinds.get(service)
    return (
        kind is None
        or service not in graph.TABLE
        or not is_installed(service)
        or getattr(kind, "SECTION", None) is not None
        or issubclass(kind, find(service, {}))
    )


def graph_of(scenario: Scenario, hosted: Mapping[str, Kind] | None = None) -> Graph:
    """Return the nodes of a scenario.

    Args:
        scenario: The scenario, which names services and user programs.
        hosted: Classes of this process, by node name. Their rows and those of user programs apply;
            all other nodes have their rows of the table.

    Raises:
        ConfigError: A node is unknown, publishes a topic of another node, or does not publish a
            topic that others wait for.
    """
    rows: list[Row] = []
    features = scenario.features
    for service in scenario.services:
        if service in graph.SERVICES and not _rows(service, scenario):
            off = service == "guard" and not scenario.guard.enabled
            cause = "guard.enabled = false" if off else f'sensor.kind = "{scenario.sensor.kind}"'
            raise ConfigError(f"services: {service} takes no part with {cause}")
        for row in _rows(service, scenario) or (own_row(service, scenario),):
            kind = (hosted or {}).get(row.name) or _program(row.name, scenario)
            placed = row if kind is None else _placed(row, kind, scenario)
            within = placed.within(features)
            if within is not None:
                rows.append(within)
    found = Graph(rows, scenario.names)
    names = {row.name for row in rows}
    for row in rows:
        for key in (i.topic.key for i in row.inputs if i.rule != "latest"):
            giver = _table(features).giver(key)
            if giver is not None and giver.name in names and found.giver(key) is None:
                program = scenario.programs.get(giver.name, giver.name)
                raise ConfigError(
                    f"{program}: in the place of {giver.name} it must give {key}, which "
                    f"{row.name} waits for"
                )
    _refuse_waits(found, scenario.programs, is_real="hardware" in features)
    if found.giver(GUARD_CMD_VEL.key):
        _refuse_bypass(rows)
    for row in rows:
        if row.name in scenario.programs:
            _check_own(row, scenario.programs[row.name], found)
    compile_plan(scenario, found)  # refuses nodes that would wait for each other
    _refuse_taken_keys(scenario, found)
    taken = {topic.key.partition("/")[0] for topic in found.topics} & set(scenario.names)
    if taken:
        raise ConfigError(f"robots: the name {taken.pop()!r} begins a key of a node: take another")
    return found


def _rows(service: str, scenario: Scenario) -> tuple[Row, ...]:
    """Return the rows of a service that take part in a scenario; none if it is unknown."""
    needed = {"", *scenario.features}
    return tuple(row for row in graph.services().get(service, ()) if row.needs in needed)


def _refuse_waits(found: Graph, programs: Mapping[str, str], *, is_real: bool) -> None:
    """Refuse a node of a whole graph that would wait for a topic that no node publishes.

    Raises:
        ConfigError: There is such a node.
    """
    if not any(row.owns_time for row in found.rows):
        return
    for row in found.rows:
        for i in row.inputs:
            waits = i.rule == "every" and not row.observes and not found.is_world(row)
            if waits and not i.topic.sensed and found.giver(i.topic.key) is None:
                lack, remedy = "no node here gives", ""
                if is_real:
                    lack, remedy = "a real robot does not have", "; leave it out (docs/hardware.md)"
                where = programs.get(row.name, "services")
                raise ConfigError(f"{where}: {row.name} needs {i.topic.key}, which {lack}{remedy}")


def _refuse_bypass(rows: Iterable[Row]) -> None:
    """Refuse a row that commands the wheels without the guard."""
    for row in rows:
        takes = CMD_VEL in [i.topic for i in row.inputs]
        if takes and JOINT_COMMAND in row.outputs:
            raise ConfigError(
                f"{row.name}: where there is a guard, who gives joint_command takes "
                "guard/cmd_vel, not cmd_vel; without one: guard.enabled = false"
            )


def _refuse_taken_keys(scenario: Scenario, found: Graph) -> None:
    """Refuse a renamed key that another topic or a query has."""
    known = [topic.key for topic in (*TOPICS, *found.topics)]
    known += [call.key for call in (*CALLS, *(call for row in found.rows for call in row.calls))]
    for robot in scenario.names:
        controller = scenario.of(robot).controller
        for name, topic in (("command_key", CMD_VEL), ("odometry_key", ODOM)):
            key = getattr(controller, name)
            if key != topic.key and (
                key in known or controller.command_key == controller.odometry_key
            ):
                raise ConfigError(
                    f"controller.{name}: {key} is the key of another topic: take another"
                )


def _check_own(row: Row, program: str, found: Graph) -> None:
    """Refuse the row of a user node that can't work in its graph."""
    known = {topic.key: topic for topic in TOPICS} | {call.key: call for call in CALLS}
    named: list[Topic[Any] | Call[Any, Any]] = [i.topic for i in row.inputs]
    named += (*row.outputs, *row.calls)
    for given in named:
        ours = known.get(given.key)
        if ours is given:
            continue
        if not re.fullmatch("[A-Za-z0-9_-]+(/[A-Za-z0-9_-]+)*", given.key):
            raise ConfigError(f"{program}: {given.key!r} is no key: names, joined by /")
        if ours is not None:
            raise ConfigError(
                f"{program}: {given.key} is a key of mecazen's own: take it from mecazen.keys"
            )
    if found.is_world(row):
        return
    triggers = [i.topic.key for i in row.inputs if i.rule == "every"]
    if row.outputs and not triggers:
        raise ConfigError(f"{program}: no input of rule `every`, and so nothing makes its steps")


@lru_cache
def _table(features: frozenset[str]) -> Graph:
    """Return all nodes of the table that could take part in a scenario with these features."""
    within = (row.within(features) for row in graph.GRAPH)
    return Graph(row for row in within if row is not None)


def _program(name: str, scenario: Scenario) -> Kind | None:
    """Return the user class that replaces a node, if there is one.

    If the class can't be imported, as in a container of another service, the table's row applies.
    """
    try:
        return find(name, scenario.programs) if name in scenario.programs else None
    except ConfigError:
        return None


def own_row(name: str, scenario: Scenario) -> Row:
    """Return the row of a node that is not in the table.

    Raises:
        ConfigError: There is no such node, or its class is not a node.
    """
    kind = find(name, scenario.programs)
    if not issubclass(kind, Node):
        raise ConfigError(f"{name}: a world or an observer takes the place of one in the table")
    return replace(kind.row(scenario), name=name)


def _placed(row: Row, kind: Kind, scenario: Scenario) -> Row:
    """Return the row of a class, placed where `row` is."""
    if issubclass(kind, Observer):
        return row
    own = kind.row(scenario)
    return own.placed(row) if row.name in graph.TABLE else replace(own, name=row.name)


def _nodes(service: str, scenario: Scenario) -> list[str]:
    """Return the names of a service's nodes, without the clock."""
    rows = _rows(service, scenario) or (Row(service),)
    return [row.name for row in rows if not row.owns_time]


def refuse_missing(service: str, scenario: Scenario) -> None:
    """Refuse a service with a missing class; import only the classes of user programs.

    Raises:
        ConfigError: There is no such class.
    """
    for name in _nodes(service, scenario):
        if name in scenario.programs or name not in graph.TABLE or not is_installed(service):
            find(name, scenario.programs)


def classes(service: str, scenario: Scenario) -> dict[str, Kind]:
    """Return the classes of a service's nodes, except the clock, by node name.

    Raises:
        ConfigError: There is no such class.
    """
    rows = _rows(service, scenario) or (Row(service),)
    found = {name: find(name, scenario.programs) for name in _nodes(service, scenario)}
    worlds = {row.name for row in rows if graph.Graph(rows).is_world(row)}
    for name, kind in found.items():
        wanted: type = World if name in worlds else Node
        wanted = Observer if rows[0].observes else wanted
        if name in graph.TABLE and not issubclass(kind, wanted):
            program = scenario.programs.get(name, name)
            raise ConfigError(f"{program}: in the place of {name} there is a {wanted.__name__}")
    return found
