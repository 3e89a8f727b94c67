"""The graph for people: tables of nodes and keys, and a picture of the data flow."""

from __future__ import annotations

from typing import Any

from mecazen.graph import Graph, Row
from mecazen.keys import DIAGNOSTICS, Topic


def rate(graph: Graph, topic: Topic[Any]) -> str:
    """Return how often a topic comes: its rate's configuration key, or `tick`."""
    if topic is DIAGNOSTICS:
        return "1 Hz"
    if graph.giver(topic.key) is None:
        return "any"
    found = graph.rate(topic.key)
    return "tick" if found is None else found if isinstance(found, str) else f"{found:g} Hz"


def source(graph: Graph, topic: Topic[Any]) -> str:
    """Return who publishes a topic."""
    if topic is DIAGNOSTICS:
        return "each service"
    giver = graph.giver(topic.key)
    if giver is None:
        return "anyone"
    return f"{giver.part_of} or anyone" if topic.open else giver.part_of


def keys_table(graph: Graph) -> str:
    """Return the table of keys in Markdown."""
    lines = ["| key | message | rate | from | meaning |", "| --- | --- | --- | --- | --- |"]
    topics = [topic for topic in graph.topics if not topic.key.startswith("diagnostics/")]
    for topic in (*topics, DIAGNOSTICS):
        kind = _name(topic.type.ROS_TYPE)
        cells = (f"`{topic.key}`", kind, rate(graph, topic), source(graph, topic), topic.meaning)
        lines.append(f"| {' | '.join(cells)} |")
    for row in graph.rows:
        for call in row.calls:
            kind = f"{_name(call.request.ROS_TYPE)} → {_name(call.answer.ROS_TYPE)}"
            cells = (f"`{call.key}`", kind, "query", row.part_of, call.meaning)
            lines.append(f"| {' | '.join(cells)} |")
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


def _name(ros_type: str) -> str:
    return ros_type.replace("/msg", "")
