"""The graph for people: tables of nodes and keys."""

from __future__ import annotations

from collections.abc import Mapping
from operator import attrgetter
from types import MappingProxyType, SimpleNamespace
from typing import Any

from mecazen.config import Scenario
from mecazen.graph import Graph
from mecazen.keys import DIAGNOSTICS, Topic
from mecazen.row import Row
from msgspec.structs import fields

Cells = tuple[str, str, str, str, str]

DEFAULTS = SimpleNamespace(**{field.name: field.default for field in fields(Scenario)})
"""The sections of a scenario with their defaults."""


def rate(graph: Graph, topic: Topic[Any]) -> str:
    """Return the rate of a topic: a configuration key, a number with Hz, `tick`, or `any`."""
    if topic is DIAGNOSTICS:
        return "1 Hz"
    if graph.giver(topic.key) is None:
        return "any"
    found = graph.rate(topic.key)
    return "tick" if found is None else found if isinstance(found, str) else f"{found:g} Hz"


def topic_rows(graph: Graph, renamed: Mapping[str, str] = MappingProxyType({})) -> list[Cells]:
    """Return key, message, rate, publisher and meaning of each topic."""
    topics = [topic for topic in graph.topics if not topic.key.startswith("diagnostics/")]
    return [
        (
            renamed.get(topic.key, topic.key),
            topic.type.ROS_TYPE,
            rate(graph, topic),
            _source(graph, topic),
            topic.meaning,
        )
        for topic in (*topics, DIAGNOSTICS)
    ]


def call_rows(graph: Graph) -> list[Cells]:
    """Return the same cells for each query."""
    givers = {call: graph.giver(call.key) for row in graph.rows for call in row.calls}
    return [
        (
            call.key,
            f"{call.request.ROS_TYPE} → {call.answer.ROS_TYPE}",
            "query",
            row.part_of if row else "",
            call.meaning,
        )
        for call, row in givers.items()
    ]


def takes(row: Row, separator: str = ", ") -> str:
    """Return a node's inputs and their rules."""
    if row.observes:
        return "everything"
    return separator.join(f"{i.topic.key} ({i.rule})" for i in row.inputs)


def gives(row: Row, separator: str = ", ", scenario: Any = None) -> str:
    """Return a node's outputs, with their rates in a scenario, and the queries that it answers."""
    rates = row.rates if scenario else {}
    outputs = [
        f"{topic.key} {in_hz(rates[topic.key], scenario)}" if topic.key in rates else topic.key
        for topic in row.outputs
    ]
    return separator.join([*outputs, *(f"{call.key}?" for call in row.calls)])


def in_hz(rate: str | float, scenario: Any) -> str:
    """Return a rate by its number, its configuration key or `tick` in Hz; other words as they are.

    Args:
        rate: As in `Row.rates`, or as `rate` returns it.
        scenario: A scenario, or `DEFAULTS`.
    """
    if isinstance(rate, str) and "." in rate:
        rate = attrgetter(rate)(scenario) or "tick"
    if rate == "tick":
        rate = 1.0 / scenario.sim.tick_s
    return rate if isinstance(rate, str) else f"{rate:g} Hz"


def _source(graph: Graph, topic: Topic[Any]) -> str:
    if topic is DIAGNOSTICS:
        return "each service"
    giver = graph.giver(topic.key)
    if giver is None:
        return "anyone"
    return f"{giver.part_of} or anyone" if topic.open else giver.part_of
