"""The graph for people: tables of nodes and keys, and a picture of the data flow."""

from __future__ import annotations

from typing import Any

from mecazen.graph import Graph
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
