"""Figures with their spread, their targets and which way is better, in groups."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

import msgspec
import numpy as np

Better = Literal["less", "more"] | float
"""Which way a figure improves; a number is the correct value."""


class Target(msgspec.Struct, frozen=True, omit_defaults=True):
    """The range in which a figure should lie; at least one end is given."""

    low: float | None = None
    high: float | None = None

    @property
    def better(self) -> Better:
        """Which way a figure approaches the range; of a closed range, its middle."""
        if self.low is None or self.high is None:
            return "less" if self.low is None else "more"
        return (self.low + self.high) / 2

    def __str__(self) -> str:
        if self.low is None or self.high is None:
            return f"< {self.high:g}" if self.low is None else f"≥ {self.low:g}"
        return f"{(self.low + self.high) / 2:g} ± {(self.high - self.low) / 2:g}"


class Figure(msgspec.Struct, frozen=True, omit_defaults=True):
    """A measured value; of several rounds, the median with the quartiles."""

    value: float
    better: Better
    quartiles: tuple[float, float] | None = None
    target: Target | None = None

    @classmethod
    def of(cls, value: float, goal: Target | Better) -> Figure:
        """Return one value with its target, or with which way is better."""
        if isinstance(goal, Target):
            return cls(value, goal.better, target=goal)
        return cls(value, goal)

    @property
    def met(self) -> bool | None:
        """Whether the value is in its target's range; None without one."""
        if self.target is None:
            return None
        low, high = self.target.low, self.target.high
        return (low is None or low <= self.value) and (high is None or self.value <= high)

    @property
    def spread(self) -> float:
        """Distance between the quartiles."""
        low, high = self.quartiles or (self.value, self.value)
        return high - low

    def badness(self, value: float) -> float:
        """Return how bad a value of this figure is; only differences have a meaning."""
        if self.better == "less":
            return value
        return -value if self.better == "more" else abs(value - self.better)

    def texts(self) -> tuple[str, str, str]:
        """Return value, quartiles and target as tables show them.

        The quartiles are empty where they look the same, the target where there is none.
        """
        low, high = map(_number, self.quartiles or (self.value, self.value))
        quartiles = f"{low} to {high}" if low != high else ""
        target = "" if self.target is None else f"{'✓' if self.met else '✗'} {self.target}"
        return _number(self.value), quartiles, target


class Row(msgspec.Struct, frozen=True):
    """What was measured on one subject: figures by their title."""

    subject: str
    figures: dict[str, Figure]


class Group(msgspec.Struct, frozen=True):
    """One table, and how its figures were measured."""

    title: str
    how: str
    rows: tuple[Row, ...]

    def markdown(self) -> str:
        """Return the group as a table of a document, a column for each title of a figure."""
        titles = list(dict.fromkeys(title for row in self.rows for title in row.figures))
        rows = [[row.subject, *(_cell(row.figures.get(t)) for t in titles)] for row in self.rows]
        table = markdown_table([["", *titles], *rows])
        return f"**{self.title}.** {self.how[:1].upper()}{self.how[1:]}.\n\n{table}"


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """Return a table of a document; the first row is its head."""
    head, *body = rows
    lines = [head, ["---"] * len(head), *body]
    return "".join(f"|{''.join(f' {cell} |' if cell else ' |' for cell in li)}\n" for li in lines)


Name = tuple[str, str, str]
"""What identifies a figure: group, subject and title."""


def named(groups: Sequence[Group]) -> Iterator[tuple[Name, Figure]]:
    """Return all figures of the groups with their names."""
    for group in groups:
        for row in group.rows:
            for title, figure in row.figures.items():
                yield (group.title, row.subject, title), figure


def merged(rounds: Sequence[Sequence[Group]]) -> list[Group]:
    """Return the groups of the first round, with medians and quartiles of all rounds."""
    if len(rounds) == 1:
        return list(rounds[0])
    values: dict[Name, list[float]] = {}
    for groups in rounds:
        for name, figure in named(groups):
            values.setdefault(name, []).append(figure.value)

    def median(name: Name, figure: Figure) -> Figure:
        low, middle, high = np.percentile(values[name], (25, 50, 75)).tolist()
        return Figure(middle, figure.better, (low, high), figure.target)

    def row(group: Group, row: Row) -> Row:
        names = ((title, (group.title, row.subject, title)) for title in row.figures)
        return Row(row.subject, {t: median(name, row.figures[t]) for t, name in names})

    how = f"medians (quartiles) of {len(rounds)} rounds"
    return [
        Group(one.title, f"{one.how}; {how}", tuple(row(one, each) for each in one.rows))
        for one in rounds[0]
    ]


def _cell(figure: Figure | None) -> str:
    if figure is None:
        return ""
    value, quartiles, target = figure.texts()
    return " ".join(filter(None, (value, quartiles and f"({quartiles})", target)))


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1e4 else f"{value:.4g}"
