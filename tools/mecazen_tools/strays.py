"""Keys that carry no samples, or whose samples have no effect, as a user should be told."""

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


def unknown_key(key: str) -> str | None:
    """Return a line with an unknown key and a similar known one.

    The result is None if a node takes or publishes the key, for a robot of any name. A user may
    have keys of their own, so an unknown key is not an error.
    """
    known: tuple[Topic[Any] | Call[Any, Any], ...] = (*TOPICS, *CALLS)
    if resolve(key, known)[1] is not None:
        return None
    close = difflib.get_close_matches(key, [entry.key for entry in known], n=1)
    meant = f"did you mean {close[0]}?" if close else "`mecazen topics` shows all"
    return f"{shortened(key)}: no key of mecazen; {meant}"


def mistake(key: str) -> str | None:
    """Return a warning of a key that carries no samples; None for an expression.

    Raises:
        BusError: The text is neither a key nor an expression.
    """
    includes(key, key)
    return None if "*" in key else asked_only(key) or unknown_key(key)


def unknown_to(bus: ZenohBus, key: str, told: str | None) -> str | None:
    """Return the warning `told` of a key, unless the running scenario names that key."""
    if told is not None and key in renamed_in(scenario_at(bus)).values():
        return None
    return told


def absent(bus: ZenohBus, key: str) -> str:
    """Return why a key may have no samples."""
    topic = topic_of(key)
    here = _alive(bus)
    givers = dict.fromkeys(row.part_of for row in GRAPH if topic in row.outputs)
    if not here:
        return "no simulation runs there"
    if topic is None or here & givers.keys():
        return "nothing has been published"
    if not givers:
        return "no service publishes it, only tools such as `mecazen pub`"
    return f"{' and '.join(givers)} would publish it, and no such service runs"


def ignored(bus: ZenohBus, key: str) -> str | None:
    """Return why samples on a key have no effect; None if they may have an effect."""
    robot, topic = resolve(key, TOPICS)
    if topic is None:
        return None
    rows = [row for row in GRAPH if not row.observes and topic in [i.topic for i in row.inputs]]
    here = _alive(bus)
    if not here.intersection(row.part_of for row in rows):
        return f"{key}: no service that runs there takes it"
    givers = here.intersection(row.part_of for row in GRAPH if topic in row.outputs)
    if givers and not topic.open:
        return f"{key}: taken only from {' and '.join(sorted(givers))}, which runs there"
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
    own = [one for one in scenario.get("robots", ()) if one.get("name") == robot]
    path = {**scenario, **(own[0] if own else {})}.get("target", {}).get("path", {})
    return bool(path.get("kind", "driven") != "driven")


def _alive(bus: ZenohBus) -> set[str]:
    """Return the names of the services that are alive, without those of robots."""
    return {part for name in bus.alive() for part in name.split("/")}


def asked_only(key: str) -> str | None:
    """Return a warning if a key only answers queries and carries no samples; None otherwise."""
    if resolve(key, CALLS)[1] is None:
        return None
    asks = "`mecazen sim`, `mecazen param` or a Zenoh tool's get"
    return f"{key}: answers queries and carries no samples; it is asked by {asks}"
