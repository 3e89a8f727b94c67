"""The graph for people: tables of nodes and keys, and a picture of the data flow."""

from __future__ import annotations

from typing import Any

from mecazen.graph import Graph, Row
from mecazen.keys import DIAGNOSTICS, Topic

Cells = tuple[str, str, str, str, str]


def rate(graph: Graph, topic: Topic[Any]) -> str:
    """Return how often a topic comes: its rate's configuration key, or `tick`."""
    if topic is DIAGNOSTICS:
        return "1 Hz"
    if graph.giver(topic.key) is None:
        return "any"
    found = graph.rate(topic.key)
    return "tick" if found is None else found if isinstance(found, str) else f"{found:g} Hz"


def topic_rows(graph: Graph) -> list[Cells]:
    """Return key, message, rate, who publishes and meaning of each topic."""
    topics = [topic for topic in graph.topics if not topic.key.startswith("diagnostics/")]
    return [
        (topic.key, topic.type.ROS_TYPE, rate(graph, topic), _source(graph, topic), topic.meaning)
        for topic in (*topics, DIAGNOSTICS)
    ]


def call_rows(graph: Graph) -> list[Cells]:
    """Return the same of each query."""
    return [
        (call.key, f"{call.request.ROS_TYPE} → {call.answer.ROS_TYPE}", "query", who, call.meaning)
        for who, call in ((row.part_of, call) for row in graph.rows for call in row.calls)
    ]


def keys_table(graph: Graph) -> str:
    """Return the table of keys in Markdown."""
    lines = ["| key | message | rate | from | meaning |", "| --- | --- | --- | --- | --- |"]
    for key, kind, *others in (*topic_rows(graph), *call_rows(graph)):
        lines.append(f"| {' | '.join((f'`{key}`', kind.replace('/msg', ''), *others))} |")
    return "\n".join(lines)


def nodes_table(graph: Graph) -> str:
    """Return the table of nodes in Markdown."""
    lines = ["| node | service | takes | gives | what it does |", "| --- | --- | --- | --- | --- |"]
    for row in graph.rows:
        cells = (f"`{row.name}`", row.part_of, takes(row), gives(row), row.summary)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def takes(row: Row) -> str:
    """Return a node's inputs and their rules."""
    if row.observes:
        return "everything"
    return ", ".join(f"{i.topic.key} ({i.rule})" for i in row.inputs)


def gives(row: Row) -> str:
    """Return a node's outputs and the queries that it answers."""
    return ", ".join([*(t.key for t in row.outputs), *(f"{c.key}?" for c in row.calls)])


def _source(graph: Graph, topic: Topic[Any]) -> str:
    if topic is DIAGNOSTICS:
        return "each service"
    giver = graph.giver(topic.key)
    if giver is None:
        return "anyone"
    return f"{giver.part_of} or anyone" if topic.open else giver.part_of
