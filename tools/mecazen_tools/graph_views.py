"""The graph for people: tables of nodes and keys, and a picture of the data flow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from operator import attrgetter
from types import MappingProxyType, SimpleNamespace
from typing import Any

from mecazen.config import Process, Scenario
from mecazen.graph import COLLECTOR, Graph, services
from mecazen.keys import DIAGNOSTICS, Topic
from mecazen.row import Row
from msgspec.structs import fields

Cells = tuple[str, str, str, str, str]

DEFAULTS = SimpleNamespace(**{field.name: field.default for field in fields(Scenario)})
"""The sections of a scenario with their defaults."""

COLUMN, LINE, LEFT, TOP = 118, 34, 356, 118
"""Widths and heights [px]: of a column, of a line, left of the columns, above the lines."""
INK, PALE, GIVES, TAKES = "#16202a", "#5b6875", "#0b5394", "#3b4a5a"
LEGEND = (
    ("gives", "gives"),
    ("every", "takes: every tick"),
    ("due", "takes: when due"),
    ("latest", "takes: the latest"),
)


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


def one_process_each() -> list[tuple[str, list[str]]]:
    """Return a process for each service, with its nodes; without the collector."""
    return [
        (Process((name,)).name, [row.name for row in rows])
        for name, rows in services().items()
        if name != COLLECTOR
    ]


def svg(graph: Graph, processes: Sequence[tuple[str, Sequence[str]]]) -> str:
    """Return the data flow as an SVG file; `processes` has the name and nodes of each."""
    nodes = [graph.row(name) for _, names in processes for name in names]
    flow = [row for row in nodes if not row.observes]
    topics = [t for t in graph.topics if any(_mark(row, t.key) for row in flow)]
    width = LEFT + COLUMN * len(nodes) + 20
    height = TOP + LINE * len(topics) + 52
    bottom = TOP + LINE * len(topics)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="Helvetica, Arial, sans-serif" font-size="13">',
        f'<rect width="{width}" height="{height}" rx="10" fill="#f7f8fa"/>',
    ]
    first = 0
    for name, names in processes:
        x = LEFT + COLUMN * first
        parts.append(
            f'<rect x="{x + 5}" y="16" width="{COLUMN * len(names) - 10}" height="{bottom - 6}" '
            f'rx="8" fill="#fff" stroke="{PALE}" stroke-dasharray="5 4"/>'
            + _text(x + COLUMN * len(names) / 2, 38, name, PALE)
        )
        first += len(names)
    for number, row in enumerate(nodes):
        middle = LEFT + COLUMN * (number + 0.5)
        parts.append(
            f'<rect x="{middle - 50}" y="52" width="100" height="36" rx="6" fill="#e8eef5" '
            f'stroke="{TAKES}"/>' + _text(middle, 75, row.name, INK, bold=True)
        )
    for line, topic in enumerate(topics):
        y = TOP + LINE * (line + 0.5)
        label = f'<tspan font-family="monospace" fill="{GIVES}">{escape(topic.key)}</tspan>'
        parts.append(f'<text x="16" y="{y + 4}">{label}</text>')
        parts.append(_text(172, y + 4, rate(graph, topic), PALE, anchor="start"))
        marks = [(n, mark) for n, row in enumerate(nodes) if (mark := _mark(row, topic.key))]
        xs = [LEFT + COLUMN * (n + 0.5) for n, _ in marks]
        begin = LEFT - 8 if topic.open or graph.giver(topic.key) is None else min(xs)
        parts.append(
            f'<path d="M{begin} {y} H{max(xs)}" stroke="{GIVES}" stroke-width="1.4" fill="none"/>'
        )
        giver = next((n for n, mark in marks if mark == "gives"), -1)
        parts += [
            _drawn(LEFT + COLUMN * (n + 0.5), y, mark, backwards=n < giver) for n, mark in marks
        ]
    left = LEFT + 14
    for mark, meaning in LEGEND:
        parts.append(_drawn(left, bottom + 32, mark))
        parts.append(_text(left + 12, bottom + 36, meaning, PALE, anchor="start"))
        left += 150
    return "\n".join([*parts, "</svg>", ""])


def _mark(row: Row, key: str) -> str | None:
    """Return the use of a topic by a node: `gives`, or the rule of its input; None: no use."""
    if key in {topic.key for topic in row.outputs}:
        return "gives"
    return next((i.rule for i in row.inputs if i.topic.key == key), None)


def _drawn(x: float, y: float, mark: str, *, backwards: bool = False) -> str:
    if mark == "gives":
        return f'<circle cx="{x}" cy="{y}" r="6" fill="{GIVES}"/>'
    fill = {"every": TAKES, "due": "#a9b8c6", "latest": "#fff"}[mark]
    tip = -7 if backwards else 7
    corners = f"M{x - tip} {y - 6} L{x + tip} {y} L{x - tip} {y + 6} z"
    return f'<path d="{corners}" fill="{fill}" stroke="{TAKES}" stroke-width="1.3"/>'


def _text(
    x: float, y: float, text: str, colour: str, *, bold: bool = False, anchor: str = "middle"
) -> str:
    weight = ' font-weight="bold"' if bold else ""
    return (
        f'<text x="{x}" y="{y}" text-anchor="{anchor}" fill="{colour}"{weight}>'
        f"{escape(text)}</text>"
    )
