"""`mecazen graph` and `mecazen topics`: tables of nodes and keys, also for the documents."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace
from operator import attrgetter
from types import MappingProxyType, SimpleNamespace
from typing import Annotated, Any

import typer
from mecazen.config import Scenario
from mecazen.graph import GRAPH, Graph
from mecazen.keys import DIAGNOSTICS, TOPICS, resolve
from mecazen.loop import turns_of
from mecazen.programs import graph_of
from mecazen.row import Row
from msgspec.structs import fields
from rich.table import Column, Table
from rich.text import Text
from typer import Argument, Option

from mecazen_tools.cli.options import Settings, console, load, receive, tool_bus
from mecazen_tools.publishers import Programs

LIVE_S = 1.0

Cells = tuple[str, str, str, str, str]

DEFAULTS: Any = SimpleNamespace(**{field.name: field.default for field in fields(Scenario)})
"""The sections of a scenario with their defaults."""


def takes(row: Row, separator: str = ", ") -> str:
    """Return a node's inputs and their rules."""
    if row.observes:
        return "everything"
    return separator.join(
        f"{i.topic.key}{' of programs' if i.topic.by_hand else ''} ({i.rule})" for i in row.inputs
    )


def gives(row: Row, separator: str = ", ", scenario: Any = None) -> str:
    """Return a node's outputs, with their rates in a scenario, and the queries that it answers."""
    rates = row.rates if scenario else {}
    outputs = [
        f"{topic.key} {in_hz(rates[topic.key], scenario)}" if topic.key in rates else topic.key
        for topic in row.outputs
    ]
    return separator.join([*outputs, *(f"{call.key}?" for call in row.calls)])


def topic_rows(graph: Graph, renamed: Mapping[str, str] = MappingProxyType({})) -> Iterator[Cells]:
    """Yield key, message, rate, publisher and meaning of each topic.

    The rate is a configuration key, a number with Hz, `tick`, or `any`.
    """
    for topic in graph.topics:
        if not topic.key.startswith("diagnostics/"):
            node = graph.giver(topic.key)
            source, rate = "anyone", "any"
            if node:
                source = f"{node.part_of} or anyone" if topic.open else node.part_of
                declared = graph.rate(topic.key) or "tick"
                rate = declared if isinstance(declared, str) else f"{declared:g} Hz"
            key = renamed.get(topic.key, topic.key)
            yield key, topic.type.ROS_TYPE, rate, source, topic.meaning
    yield DIAGNOSTICS.key, DIAGNOSTICS.type.ROS_TYPE, "1 Hz", "each service", DIAGNOSTICS.meaning


def call_rows(graph: Graph) -> Iterator[Cells]:
    """Yield the same cells for each query."""
    for call in dict.fromkeys(call for row in graph.rows for call in row.calls):
        node = graph.giver(call.key)
        types = f"{call.request.ROS_TYPE} → {call.answer.ROS_TYPE}"
        yield call.key, types, "query", node.part_of if node else "", call.meaning


def in_hz(rate: str | float, scenario: Any) -> str:
    """Return a rate by its number, its configuration key or `tick` in Hz; other words as they are.

    Args:
        rate: As in `Row.rates` or `topic_rows`.
        scenario: A scenario, or `DEFAULTS`.
    """
    if isinstance(rate, str) and "." in rate:
        rate = attrgetter(rate)(scenario) or "tick"
    if rate == "tick":
        rate = 1.0 / scenario.sim.tick_s
    return rate if isinstance(rate, str) else f"{rate:g} Hz"


def graph(
    scenario: Annotated[
        str | None,
        Argument(
            metavar="[SCENARIO]", help="Scenario whose nodes are shown; without it, all nodes."
        ),
    ] = None,
    settings: Settings = None,
) -> None:
    """Show nodes in the order in which they run, with inputs, outputs and processes.

    Example: mecazen graph back
    """
    loaded = DEFAULTS
    rows = GRAPH
    process_of = {row.name: row.part_of for row in GRAPH}
    if scenario is not None:
        loaded = load(scenario, settings)
        nodes = graph_of(loaded)
        process_of |= {
            row.name: process.name
            for process in loaded.process_plan
            if process.robot in ("", loaded.names[0])
            for service in process.services
            for row in nodes.services[service]
        }
        turns = [turn.row.name for turn in turns_of(loaded, nodes)]
        last = [row.name for row in nodes.rows if row.observes]  # observers take no turn
        rows = tuple(map(nodes.row, dict.fromkeys((*turns, *last))))
    table = Table("node", "takes", "gives, answers?", show_lines=True)
    for row in rows:
        process = process_of.get(row.name, row.name)
        place = row.name if process == row.name else f"{row.name}\nin {process}"
        table.add_row(*map(Text, (place, takes(row, "\n"), gives(row, "\n", loaded))))
    console(160).print(table)


def topics(
    context: typer.Context,
    scenario: Annotated[
        str | None,
        Argument(metavar="[SCENARIO]", help="Scenario whose nodes and topics are shown."),
    ] = None,
    live: Annotated[
        bool, Option("--live", help=f"Measure rates for {LIVE_S:g} s, and list the publishers.")
    ] = False,
) -> None:
    """Show the table of keys: message, rate, publisher, and the services that answer queries."""
    loaded = DEFAULTS if scenario is None else load(scenario, None)
    nodes = Graph(GRAPH) if scenario is None else graph_of(loaded)
    renamed = {} if scenario is None else loaded.of(loaded.names[0]).renamed
    rates, publishers = _live(context, nodes, renamed) if live else ({}, {})
    names = ["message", "rate", "from", "meaning", *(["Hz now", "publishers"] if live else [])]
    table = Table(Column("key", no_wrap=True), *(Column(name, overflow="fold") for name in names))
    for key, message, rate, *cells in topic_rows(nodes, renamed):
        measured = [rates.get(key, "0"), publishers.get(key, "")] if live else []
        shown = key, message.replace("/msg", ""), in_hz(rate, loaded), *cells, *measured
        table.add_row(*map(Text, shown))  # Text: a unit in brackets is not markup
    table.add_section()
    for key, message, *cells in call_rows(nodes):
        table.add_row(*map(Text, (key, message.replace("/msg", ""), *cells)))
    console(200).print(table)


def _live(
    context: typer.Context, nodes: Graph, renamed: Mapping[str, str]
) -> tuple[dict[str, str], dict[str, str]]:
    """Return rates and publishers on a bus by key, a line for each robot."""
    topics = {topic.key: topic for topic in (*nodes.topics, *TOPICS)}.values()
    known = [replace(topic, key=renamed.get(topic.key, topic.key)) for topic in topics]
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    """Number of samples by key, without the robot's name, and by robot."""

    def count(key: str, *_: object) -> None:
        robot, topic = resolve(key, known)
        if topic is not None:
            counts[topic.key][robot] += 1

    publishers: dict[str, list[str]] = defaultdict(list)
    with tool_bus(context) as bus:
        bus.subscribe_bytes("**", count)
        receive(bus, LIVE_S)
        programs = Programs(bus)
        for key, ids in programs.publishers.items():
            robot, topic = resolve(key.removeprefix(bus.prefix), known)
            if topic is not None and key.startswith(bus.prefix):
                names = " and ".join(map(programs.name, ids))
                publishers[topic.key].append(f"{robot} {names}".strip())
    rates = {
        key: "\n".join(
            f"{robot} {count / LIVE_S:.0f}".strip() for robot, count in sorted(counter.items())
        )
        for key, counter in counts.items()
    }
    return rates, {key: "\n".join(sorted(lines)) for key, lines in publishers.items()}
