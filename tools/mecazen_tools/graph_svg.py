"""The data flow of a graph as a picture: a line for each topic, a column for each node."""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import escape

from mecazen.graph import Graph, Row

from mecazen_tools.graph_tables import rate

COLUMN, LINE, LEFT, TOP = 118, 34, 356, 118
"""Widths and heights [px]: of a column, of a line, left of the columns, above the lines."""
INK, PALE, GIVES, TAKES = "#16202a", "#5b6875", "#0b5394", "#3b4a5a"


def svg(graph: Graph, processes: Sequence[tuple[str, Sequence[str]]]) -> str:
    """Return an SVG file.

    Args:
        graph: The nodes.
        processes: Names of processes, and the nodes of each.
    """
    nodes = [graph.row(name) for _, names in processes for name in names]
    flow = [row for row in nodes if not row.observes]
    topics = [t for t in graph.topics if any(t.key in _keys(row) for row in flow)]
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
    for mark, meaning in _LEGEND:
        parts.append(_drawn(left, bottom + 32, mark))
        parts.append(_text(left + 12, bottom + 36, meaning, PALE, anchor="start"))
        left += 150
    return "\n".join([*parts, "</svg>", ""])


_LEGEND = (
    ("gives", "gives"),
    ("every", "takes: every tick"),
    ("due", "takes: when due"),
    ("latest", "takes: the latest"),
)


def _keys(row: Row) -> set[str]:
    return {t.key for t in row.outputs} | {i.topic.key for i in row.inputs}


def _mark(row: Row, key: str) -> str | None:
    """Return what a node does with a topic."""
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
