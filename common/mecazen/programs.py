"""Finds the classes of the nodes of a scenario, and the graph of these nodes."""

from __future__ import annotations

import difflib
import importlib
import importlib.util
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from mecazen.commands import topics
from mecazen.config import Scenario
from mecazen.errors import ConfigError, explained, is_installed
from mecazen.graph import NODES, SERVICES, Graph, rows, services
from mecazen.keys import CALLS, CMD_VEL, GUARD_CMD_VEL, JOINT_COMMAND, ODOM, TOPICS, Call, Topic
from mecazen.loop import turns_of
from mecazen.node import Node
from mecazen.row import Row, due, latest
from mecazen.runtime.observer import Observer
from mecazen.schema import Section

Kind = type[Node] | type[Observer]

CHOOSE = ("guard", "controller")
"""Nodes that choose among commands."""


def find(name: str, programs: Mapping[str, str]) -> Kind:
    """Return the class of a node: by its name or `file.py:Class`, or of the program in its place.

    Raises:
        ConfigError: There is no such class, or its extra is not installed.
    """
    program = programs.get(name, name)
    if program in NODES and NODES[program].program:
        row = NODES[program]
        if not is_installed(row.part_of):
            raise ConfigError(f"{name} is not installed: pip install 'mecazen[{row.part_of}]'")
        return _class_of(row.program, program)
    if ":" not in program:
        if program.endswith(".py"):
            raise ConfigError(f"{program}: add the class, such as {program}:MyFollower")
        nodes = ", ".join(sorted(row.name for row in NODES.values() if row.program))
        raise ConfigError(f"{program}: no such node; nodes: {nodes}; or file.py:Class of your own")
    return _class_of(program, name)


def imported(program: str) -> object:
    """Return the object that `file.py:Name` or `module:Name` names; None: there is no such name.

    Raises:
        ConfigError: The file or module can't be imported.
    """
    place, _, attribute = program.partition(":")
    return getattr(_import(place), attribute, None)


def _class_of(program: str, name: str) -> Kind:
    """Return the class of a node that `file.py:Class` or `module:Class` names.

    Raises:
        ConfigError: The class does not exist, or it can't be the node `name`.
    """
    kind = imported(program)
    place, _, attribute = program.partition(":")
    if kind is None:
        close = difflib.get_close_matches(attribute, dir(_import(place)), n=1)
        meant = f"; did you mean {close[0]}?" if close else ""
        raise ConfigError(f"{program}: no such class in {place}{meant}")
    if not (isinstance(kind, type) and issubclass(kind, Node | Observer)):
        raise ConfigError(f"{program}: not a subclass of mecazen.node.Node")
    if issubclass(kind, Node) and not isinstance(kind.ROW, Row) and name not in NODES:
        raise ConfigError(f"{program}: needs ROW, its row of the graph")
    section = getattr(kind, "SECTION", None)
    if section is not None and not (isinstance(section, type) and issubclass(section, Section)):
        raise ConfigError(f"{program}: SECTION must be a subclass of mecazen.schema.Section")
    return kind


def _import(place: str) -> ModuleType:
    is_file = place.endswith(".py")
    if not is_file and not all(part.isidentifier() for part in place.split(".")):
        raise ConfigError(f"{place or repr(place)}: neither file.py nor a module's name")
    if is_file and (Path(place).is_fifo() or Path(place).is_char_device()):  # without an end
        raise ConfigError(f"{place}: must be a regular file, not a device or a pipe")
    try:
        return _from_file(place) if is_file else importlib.import_module(place)
    except OSError as error:
        raise ConfigError(f"{place}: can't be imported: {error.strerror}") from None
    except (ImportError, SyntaxError) as error:
        raise ConfigError(f"{place}: can't be imported: {error}") from None
    except Exception as error:
        raise ConfigError(f"{place}: can't be imported: {explained(error)}") from error


@cache  # nodes of one file share its topics and messages
def _from_file(place: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(Path(place).stem, place)
    assert spec is not None  # as for every name that ends in .py
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def graph_of(scenario: Scenario, kinds: Mapping[str, Kind] | None = None) -> Graph:
    """Return the nodes of a scenario.

    Args:
        scenario: The scenario, which names services and user programs.
        kinds: Classes of this process, by node name. Their rows and those of user programs apply;
            all other nodes have the rows of the graph.

    Raises:
        ConfigError: A node is unknown, publishes a topic of another node, or does not publish a
            topic that others wait for.
    """
    by_hand = topics(scenario)
    graph = Graph(
        (
            _row(_with_commands(row, by_hand), scenario, kinds or {})
            for service in scenario.services
            for row in _rows(service, scenario)
        ),
        scenario.names,
    )
    _refuse_two_givers(graph)
    _refuse_silent_places(graph, scenario)
    _refuse_waits(graph, scenario)
    _refuse_bypass(graph)
    for row in graph.rows:
        if row.name in scenario.programs:
            _check_user_row(row, scenario.programs[row.name])
    turns_of(scenario, graph)  # refuses nodes that would wait for each other
    _refuse_taken_keys(scenario, graph)
    return graph


def _rows(service: str, scenario: Scenario) -> tuple[Row, ...]:
    """Return the rows of a service that take part in a scenario.

    Raises:
        ConfigError: None takes part, or no class has the name of the service.
    """
    if nodes := services(rows(scenario.features)).get(service):
        return nodes
    if service in SERVICES:
        off = service == "guard" and not scenario.guard.enabled
        cause = "guard.enabled = false" if off else f'sensor.kind = "{scenario.sensor.kind}"'
        raise ConfigError(f"services: {service} takes no part with {cause}")
    kind = find(service, scenario.programs)
    if not issubclass(kind, Node) or kind.ROW is None:
        raise ConfigError(f"{service}: an observer takes the place of one in the graph")
    return (replace(kind.ROW, name=service),)


def _with_commands(row: Row, by_hand: Iterable[Topic[Any]]) -> Row:
    """Return the row of the guard or the controller with all topics of commands that it takes."""
    if row.name not in CHOOSE or CMD_VEL not in [i.topic for i in row.inputs]:
        return row
    inputs = (
        latest(topic, revises=True) if topic.by_hand else due(topic, revises=True)
        for topic in by_hand
    )
    return replace(row, inputs=(*row.inputs, *inputs))


def _row(row: Row, scenario: Scenario, kinds: Mapping[str, Kind]) -> Row:
    kind = kinds.get(row.name)
    if kind is None and row.name in scenario.programs:
        with suppress(ConfigError):  # the class may be needed in another process only
            kind = find(row.name, scenario.programs)
    if kind is None or not issubclass(kind, Node) or kind.ROW is None:
        return row
    return kind.ROW.placed(row)


def _refuse_two_givers(graph: Graph) -> None:
    givers: dict[str, Row] = {}
    for row in graph.rows:
        for key in row.gives:
            giver = givers.setdefault(key, row)
            if giver is not row:
                raise ConfigError(f"{giver.name} and {row.name} both give {key}")


def _refuse_silent_places(graph: Graph, scenario: Scenario) -> None:
    """Refuse a user class that lacks an output of its place for which others wait."""
    names = {row.name for row in graph.rows}
    replaced = _graph_of_features(scenario.features)
    for row in graph.rows:
        for key in (i.topic.key for i in row.inputs if i.rule != "latest"):
            giver = replaced.giver(key)
            if giver is not None and giver.name in names and graph.giver(key) is None:
                program = scenario.programs.get(giver.name, giver.name)
                raise ConfigError(
                    f"{program}: in the place of {giver.name} it must give {key}, which "
                    f"{row.name} waits for"
                )


@cache
def _graph_of_features(features: frozenset[str]) -> Graph:
    return Graph(rows(features))


def _refuse_waits(graph: Graph, scenario: Scenario) -> None:
    """Refuse a node of a whole graph that would wait for a topic that no node publishes."""
    if not any(row.owns_time for row in graph.rows):
        return
    for row in graph.rows:
        for i in row.inputs:
            if i.rule == "every" and not i.topic.sensed and graph.giver(i.topic.key) is None:
                lack, remedy = "no node here gives", ""
                if "hardware" in scenario.features:
                    lack, remedy = "a real robot does not have", "; leave it out (docs/hardware.md)"
                where = scenario.programs.get(row.name, "services")
                raise ConfigError(f"{where}: {row.name} needs {i.topic.key}, which {lack}{remedy}")


def _refuse_bypass(graph: Graph) -> None:
    for row in graph.rows if graph.giver(GUARD_CMD_VEL.key) else ():
        if CMD_VEL in [i.topic for i in row.inputs] and JOINT_COMMAND in row.outputs:
            raise ConfigError(
                f"{row.name}: where there is a guard, who gives joint_command takes "
                "guard/cmd_vel, not cmd_vel; without one: guard.enabled = false"
            )


def _refuse_taken_keys(scenario: Scenario, graph: Graph) -> None:
    """Refuse a renamed key or a robot's name that another topic or a query has."""
    known = {topic.key for topic in (*TOPICS, *graph.topics)} | {call.key for call in CALLS}
    known |= {key for row in graph.rows for key in row.gives}
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
        taken = {topic.key for topic in TOPICS if topic is not CMD_VEL}
        taken |= {call.key for call in CALLS} | {controller.command_key, controller.odometry_key}
        for command in controller.commands:
            if command.key in taken - {CMD_VEL.key}:
                raise ConfigError(
                    f"controller.commands: {command.key} is the key of another topic: take another"
                )
        if robot in {topic.key.partition("/")[0] for topic in graph.topics}:
            raise ConfigError(f"robots: the name {robot!r} begins a key of a node: take another")


def _check_user_row(row: Row, program: str) -> None:
    entries: list[Topic[Any] | Call[Any, Any]] = [*TOPICS, *CALLS]
    known = {entry.key: entry for entry in entries}
    entries = [*(i.topic for i in row.inputs), *row.outputs, *row.calls]
    for entry in entries:
        if known.get(entry.key) is entry:
            continue
        if not re.fullmatch("[A-Za-z0-9_-]+(/[A-Za-z0-9_-]+)*", entry.key):
            raise ConfigError(f"{program}: {entry.key!r} is no key: names, joined by /")
        if entry.key in known:
            raise ConfigError(
                f"{program}: {entry.key} is a key of mecazen's own: take it from mecazen.keys"
            )
    if row.outputs and not any(i.rule == "every" for i in row.inputs):
        raise ConfigError(f"{program}: no input of rule `every`, and so nothing makes its steps")


def classes(service: str, scenario: Scenario) -> dict[str, Kind]:
    """Return the classes of a service's nodes, by node name.

    Raises:
        ConfigError: There is no such class.
    """
    kinds: dict[str, Kind] = {}
    for row in _rows(service, scenario):
        name = row.name
        if row.owns_time:
            continue
        kinds[name] = find(name, scenario.programs)
        wanted: type = Observer if row.observes else Node
        if not issubclass(kinds[name], wanted):
            program = scenario.programs.get(name, name)
            kind = f"{wanted.__module__}.{wanted.__name__}"
            raise ConfigError(f"{program}: in the place of {name} it must be a subclass of {kind}")
    return kinds


def refuse_missing(service: str, scenario: Scenario) -> None:
    """Refuse a service with a missing class; import only the classes of user programs.

    Raises:
        ConfigError: There is no such class.
    """
    for row in _rows(service, scenario):
        user = row.name in scenario.programs or row.name not in NODES
        if not row.owns_time and (user or not is_installed(service)):
            find(row.name, scenario.programs)
