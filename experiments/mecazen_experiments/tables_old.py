"""Tables of experiments for the terminal: each mean above its 95 % interval."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from rich.table import Column as Head
from rich.table import Table
from rich.text import Text

from mecazen_experiments.report import Row
from mecazen_experiments.statistics import Interval

CAPTION = (
    "means, each with its 95 % interval over the n independent units: recorded walks, or seeds; of "
    "two units, both values"
)

Column = tuple[str, str, int]
"""Heading, name of a score, and digits to show."""


def table(
    heads: Sequence[str],
    columns: Iterable[Column],
    rows: Iterable[Row[Any]],
    title: str | None = None,
    caption: str = CAPTION,
    more: Mapping[str, Callable[[Row[Any]], str]] | None = None,
) -> Table:
    """Return a table with a line for each row: its labels below `heads`, and its scores.

    With a single head, the column shows the names of the rows. `more` are further columns by
    heading.
    """
    more = more or {}
    columns = list(columns)
    shown = Table(
        *(Head(head, overflow="fold", no_wrap=len(heads) > 1) for head in heads),
        *("n", *(heading for heading, *_ in columns), *more),
        show_lines=True,
        title=title,
        caption=caption,
    )
    for row in rows:
        labels = map(str, row.labels.values() if len(heads) > 1 else [row.name])
        cells = (_cell(row, name, digits) for _, name, digits in columns)
        # a label is never interpreted as markup
        rest = (of(row) for of in more.values())
        shown.add_row(*map(Text, labels), _count(row), *cells, *rest)
    return shown


def _count(row: Row[Any]) -> str:
    n = len(row.runs)
    return str(n) if row.units == n else f"{row.units}\n{n} runs"


def show(interval: Interval | None, digits: int) -> str:
    """Return a mean and, on a separate line, its interval; of two units, return both values."""
    if interval is None:
        return "-"
    if interval.n == 1:
        return f"{interval.mean:.{digits}f}"
    if interval.n == 2:
        return ", ".join(f"{value:.{digits}f}" for value in interval.values)
    return "{0:.{3}f}\n[dim]{1:.{3}f} … {2:.{3}f}[/]".format(
        interval.mean, interval.low, interval.high, digits
    )


def _cell(row: Row[Any], name: str, digits: int) -> str:
    if name in row.sums:
        return f"{row.sums[name]:g}"
    if name in row.least:
        least = row.least[name]
        return "" if least is None else f"{least:.{digits}f}"
    return show(row.means.get(name), digits)
