"""Figures with their spread, their targets and which way is better, in groups."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Literal

import msgspec
import numpy as np

Better = Literal["less", "more"] | float
"""Which way a figure gets better: or, as a number, the value that is right."""


class Target(msgspec.Struct, frozen=True):
    """The range in which a figure should be, and that range in words."""

    text: str
    low: float | None = None
    high: float | None = None

    @classmethod
    def at_least(cls, low: float) -> Target:
        """Return the range from `low` up."""
        return cls(f"≥ {low:g}", low=low)

    @classmethod
    def below(cls, high: float) -> Target:
        """Return the range up to `high`."""
        return cls(f"< {high:g}", high=high)

    @classmethod
    def around(cls, middle: float, deviation: float) -> Target:
        """Return the range of `deviation` to both sides."""
        return cls(f"{middle:g} ± {deviation:g}", low=middle - deviation, high=middle + deviation)

    @property
    def better(self) -> Better:
        """Which way a figure comes nearer to the range, and deeper into it."""
        if self.high is None:
            return "more"
        return "less" if self.low is None else (self.low + self.high) / 2

    def met_by(self, value: float) -> bool:
        """Return whether `value` is within the range."""
        low = -math.inf if self.low is None else self.low
        high = math.inf if self.high is None else self.high
        return low <= value <= high


class Figure(msgspec.Struct, frozen=True):
    """A measured value; of several rounds the median, with their quartiles."""

    value: float
    better: Better
    quartiles: tuple[float, float] | None = None
    target: Target | None = None

    @classmethod
    def of(cls, value: float, goal: Target | Better) -> Figure:
        """Return one value; without a target it is known at least which way is better."""
        if isinstance(goal, Target):
            return cls(value, goal.better, target=goal)
        return cls(value, goal)

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None without one."""
        return None if self.target is None else self.target.met_by(self.value)

    @property
    def spread(self) -> float:
        """The distance of the quartiles."""
        low, high = self.quartiles or (self.value, self.value)
        return high - low

    def badness(self, value: float) -> float:
        """Return how bad a value of this figure is, in its unit: differences count."""
        if self.better == "less":
            return value
        if self.better == "more":
            return -value
        return abs(value - self.better)

    def texts(self) -> tuple[str, str, str]:
        """Return value, quartiles and target as tables show them.

        Without a target, or quartiles that differ as they are shown, there is an empty text.
        """
        quartiles = target = ""
        if self.quartiles is not None:
            low, high = map(_number, self.quartiles)
            quartiles = f"{low} to {high}" if low != high else ""
        if self.target is not None:
            target = f"{'✓' if self.met else '✗'} {self.target.text}"
        return _number(self.value), quartiles, target


class Row(msgspec.Struct, frozen=True):
    """What was measured on one thing: figures by their title."""

    subject: str
    figures: dict[str, Figure]


class Group(msgspec.Struct, frozen=True):
    """What belongs together, and how it was measured."""

    title: str
    how: str
    rows: tuple[Row, ...]

    def markdown(self) -> str:
        """Return the group as a table of a document: a column for each title of a figure."""
        titles = list(dict.fromkeys(title for row in self.rows for title in row.figures))
        lines = [["", *titles], ["---"] * (len(titles) + 1)]
        for row in self.rows:
            cells = (row.figures[title].texts() if title in row.figures else () for title in titles)
            lines.append([row.subject, *map(_cell, cells)])
        table = "\n".join(
            f"|{''.join(f' {cell} |' if cell else ' |' for cell in line)}" for line in lines
        )
        return f"### {self.title}\n\n{table}\n\n{self.how[:1].upper()}{self.how[1:]}.\n"


Named = tuple[tuple[str, str, str], Figure]
"""A figure by group, subject and title."""


def named(groups: Sequence[Group]) -> Iterator[Named]:
    """Return all figures of the groups with their names."""
    for group in groups:
        for row in group.rows:
            for title, figure in row.figures.items():
                yield (group.title, row.subject, title), figure


def merged(rounds: Sequence[Sequence[Group]]) -> list[Group]:
    """Return the groups of the first round, with medians and quartiles of all rounds."""
    values: dict[tuple[str, str, str], list[float]] = {}
    for groups in rounds:
        for name, figure in named(groups):
            values.setdefault(name, []).append(figure.value)
    return [
        Group(
            group.title,
            f"{group.how}; medians (quartiles) of {len(rounds)} rounds"
            if len(rounds) > 1
            else group.how,
            tuple(
                Row(
                    row.subject,
                    {
                        title: _median(figure, values[group.title, row.subject, title])
                        for title, figure in row.figures.items()
                    },
                )
                for row in group.rows
            ),
        )
        for group in rounds[0]
    ]


def _median(figure: Figure, values: Sequence[float]) -> Figure:
    low, middle, high = np.percentile(values, (25, 50, 75)).tolist()
    quartiles = (low, high) if len(values) > 1 else None
    return Figure(middle, figure.better, quartiles, figure.target)


def _cell(texts: tuple[str, ...]) -> str:
    if not texts:
        return ""
    value, quartiles, target = texts
    spread = f" ({quartiles})" if quartiles else ""
    return f"{value}{spread} {target}".rstrip()


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1e4 else f"{value:.4g}"
