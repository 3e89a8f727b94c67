"""Warnings about keys without samples, and about samples without effect.

A client that mistypes a key gets no error: the sample has no recipient.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping
from typing import Any

from mecazen.bus.session import includes
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.errors import BusError
from mecazen.graph import GRAPH
from mecazen.keys import (
    CALLS,
    SIM_SCENARIO,
    TARGET_CMD_VEL,
    TOPICS,
    Call,
    Topic,
    resolve,
    topic_of,
)
from mecazen.loading import renamed_in
from mecazen.messages import Empty
from mecazen.text import shortened

OWN_WAY = "the person goes their own way: target.path = { kind = 'driven' } obeys"
ANSWER_S = 1.0
"""Timeout of a query [s]."""
OPEN = tuple(topic.key for topic in TOPICS if topic.open)
"""Keys on which any client may publish."""


def mistake(key: str) -> str | None:
    """Return a warning about a key that carries no samples; None for an expression.

    A user may have keys of their own, so an unknown key is not an error.

    Raises:
        BusError: The text is neither a key nor an expression.
    """
    includes(key, key)
    entries: tuple[Topic[Any] | Call[Any, Any], ...] = (*TOPICS, *CALLS)
    if "*" in key or resolve(key, TOPICS)[1] is not None:
        return None
    if resolve(key, CALLS)[1] is not None:
        asks = "`mecazen sim`, `mecazen param` or a Zenoh tool's get"
        return f"{key}: answers queries and carries no samples; it is asked by {asks}"
    close = difflib.get_close_matches(key, [entry.key for entry in entries], n=1)
    hint = f"did you mean {close[0]}?" if close else "`mecazen topics` shows all"
    return f"{shortened(key)}: no key of mecazen; {hint}"


def unknown_to(bus: ZenohBus, key: str, warning: str | None) -> str | None:
    """Return the warning about a key, unless the running scenario names that key."""
    if warning is None:
        return None
    scenario = scenario_at(bus)
    commands = scenario.get("controller", {}).get("commands", ())
    named = [*renamed_in(scenario).values(), *(str(command["key"]) for command in commands)]
    is_named = any(key == name or key.endswith(f"/{name}") for name in named)
    return None if is_named else warning


def absent(bus: ZenohBus, key: str) -> str:
    """Return why a key may have no samples."""
    topic = topic_of(key)
    alive = _alive(bus)
    publishers = dict.fromkeys(row.part_of for row in GRAPH if topic in row.outputs)
    if not alive:
        return "no simulation runs there"
    if topic is None or alive & publishers.keys():
        return "nothing has been published"
    if not publishers:
        return "no service publishes it, only tools such as `mecazen pub`"
    return f"{' and '.join(publishers)} would publish it, and no such service runs"


def ignored(bus: ZenohBus, key: str) -> str | None:
    """Return why samples on a key have no effect; None if they may have an effect."""
    robot, topic = resolve(key, TOPICS)
    if topic is None:
        return None
    alive = _alive(bus)
    rows = [row for row in GRAPH if not row.observes and topic in [i.topic for i in row.inputs]]
    if not alive.intersection(row.part_of for row in rows):
        return f"{key}: no service that runs there takes it"
    publishers = alive.intersection(row.part_of for row in GRAPH if topic in row.outputs)
    if publishers and not topic.open:
        return f"{key}: taken only from {' and '.join(sorted(publishers))}, which runs there"
    if topic is TARGET_CMD_VEL and goes_own_way(scenario_at(bus), robot):
        return f"{key}: {OWN_WAY}"
    return None


def scenario_at(bus: ZenohBus) -> dict[str, Any]:
    """Return the tables of the running scenario; empty if no service answers."""
    try:
        return tomllib.loads(bus.call(SIM_SCENARIO, Empty(), ANSWER_S).data)
    except (BusError, ValueError):
        return {}


def goes_own_way(scenario: Mapping[str, Any], robot: str) -> bool:
    """Return whether the person of a robot takes no commands."""
    tables = [table for table in scenario.get("robots", ()) if table.get("name") == robot]
    path = {**scenario, **(tables[0] if tables else {})}.get("target", {}).get("path", {})
    return bool(path.get("kind", "driven") != "driven")


def _alive(bus: ZenohBus) -> set[str]:
    """Return the names of the services that are alive, without those of robots."""
    return {part for name in bus.alive() for part in name.split("/")}
