"""Figures with their spread and their targets, and tables of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from rich.table import Table


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

    def met_by(self, value: float) -> bool:
        """Return whether `value` is within the range."""
        low = -math.inf if self.low is None else self.low
        high = math.inf if self.high is None else self.high
        return low <= value <= high


class Figure(msgspec.Struct, frozen=True):
    """A measured value; where it is a median, with the quartiles of its repetitions."""

    value: float
    quartiles: tuple[float, float] | None = None
    target: Target | None = None
    met: bool | None = None

    @classmethod
    def of(cls, value: float, target: Target | None = None) -> Figure:
        """Return one value, held against its target."""
        return cls(value, None, target, None if target is None else target.met_by(value))

    @classmethod
    def median(cls, values: Sequence[float], target: Target | None = None) -> Figure:
        """Return the median of repetitions and their spread, held against its target."""
        low, middle, high = np.percentile(values, (25, 50, 75)).tolist()
        met = None if target is None else target.met_by(middle)
        return cls(middle, (low, high), target, met)

    def cell(self) -> str:
        """Return the figure as a table shows it."""
        text = f"{self.value:.4g}"
        if self.quartiles is not None:
            low, high = self.quartiles
            text += f" [dim]({low:.4g} to {high:.4g})[/]"
        if self.target is not None:
            colour, mark = ("green", "✓") if self.met else ("red", "✗")
            text += f" [{colour}]{mark} {self.target.text}[/]"
        return text


class Row(msgspec.Struct, frozen=True):
    """What was measured on one thing: figures by their column's title."""

    subject: str
    figures: dict[str, Figure]


class Group(msgspec.Struct, frozen=True):
    """A table: what belongs together, and how it was measured."""

    title: str
    how: str
    rows: tuple[Row, ...]

    def table(self) -> Table:
        """Return the group for the terminal; targets stand beside their figures."""
        columns = dict.fromkeys(title for row in self.rows for title in row.figures)
        table = Table("", *columns, title=self.title, caption=self.how, title_justify="left")
        for row in self.rows:
            cells = (row.figures[title].cell() if title in row.figures else "" for title in columns)
            table.add_row(row.subject, *cells)
        return table
