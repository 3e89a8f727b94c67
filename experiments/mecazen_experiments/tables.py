"""Tables of a study: rows of runs, means over independent units, and their 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from statistics import fmean
from typing import Any, NamedTuple

import pandas as pd
from mecazen.errors import ConfigError
from mecazen_tools.statistics import (
    LEAST_UNITS,
    Interval,
    mean_interval,
    paired_difference,
    show,
)
from rich.table import Table as RichTable
from rich.text import Text

from mecazen_experiments.frame import select
from mecazen_experiments.statistics import most_per_hour, paired_ratio, share_interval
from mecazen_experiments.study import Column, Label, Study, StudyTable, check_known

PAIRED = {"difference": paired_difference, "ratio": paired_ratio}
"""Ways to compare a row with the reference row, unit by unit."""
REDUCTIONS: dict[str, Callable[[list[float]], float]] = {
    "sum": math.fsum,
    "min": min,
    "max": max,
}
CAPTION = (
    "Means, each with its 95 % interval over the n independent units; of two units, both values."
)
VERDICT = f"✓ and ✗ from {LEAST_UNITS} units on: the whole interval is within the limit, or not."


class TextTable(NamedTuple):
    """A table as text."""

    title: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]
    note: str


def make_tables(study: Study, frame: pd.DataFrame) -> list[TextTable]:
    """Return the tables of a study that have rows."""
    tables = [make_table(frame, table) for table in study.tables]
    return [table for table in tables if table.rows]


def make_table(frame: pd.DataFrame, table: StudyTable) -> TextTable:
    """Return a table of a frame.

    A row's cells are its labels, n (the number of independent units, and of runs if there are
    more), and its columns. The values of a unit are averaged first.

    Raises:
        ConfigError: One line with the table, and the name or the query that is wrong.
    """
    where = f"table {table.title!r}"
    rows, words = [], [*product(*table.each.values())]
    for values, group in _groups(select(frame, table.where, f"{where}: where"), table.rows):
        units = group.groupby(table.units, sort=False, dropna=False)
        count = f"{len(units)}" if len(units) == len(group) else f"{len(units)} ({len(group)} runs)"
        reference = _reference(frame, table, values)
        for word in words:
            cells = []
            for column in table.shown:
                name = column.name.format_map(dict(zip(table.each, word, strict=True)))
                runs = _by_unit(group, table.units, name)
                if column.how in PAIRED:
                    base = {} if reference is None else _by_unit(reference, table.units, name)
                    cells.append(_paired(column, name, group, runs, base))
                else:
                    cells.append(_cell(column, name, group, runs, len(units)))
            rows.append((*word, *map(_label, values), count, *cells))
    head = (*table.each, *table.rows, "n", *(column.header for column in table.shown))
    hows = {column.how for column in table.shown}
    notes = [table.note] if table.note else []
    if hows & {"mean", "share", *PAIRED}:
        notes.append(CAPTION)
    if any(cell.endswith(("✓", "✗")) for row in rows for cell in row):
        notes.append(VERDICT)
    return TextTable(table.title, head, rows, " ".join(notes))


def check(study: Study, frame: pd.DataFrame) -> None:
    """Check all names and queries of a study's tables and figures against a frame, of any runs.

    Raises:
        ConfigError: One line with the place, the name, and the known names.
    """
    known = [*frame.columns]
    for table in study.tables:
        _check_table(table, frame)
    for figure in study.figures:
        where = f"figure {figure.name!r}"
        select(frame, figure.where, f"{where}: where")
        for key, names in (("x", [figure.x]), ("y", figure.panels), ("by", [figure.by])):
            for name in filter(None, names):
                check_known(name, known, f"{where}: {key}: no column", ConfigError)
    scores = [name for name in known if not name.startswith(("limit_", "published_"))]
    for case, key in product(study.cases, ("published", "limits")):
        for name in getattr(case, key):
            place = f"case {case.name!r}: {key}: no score"
            check_known(name.removesuffix("_ratio"), scores, place, ConfigError)


def _check_table(table: StudyTable, frame: pd.DataFrame) -> None:
    where, known = f"table {table.title!r}", [*frame.columns]
    select(frame, table.where, f"{where}: where")
    for key, names in (("rows", table.rows), ("unit", table.units)):
        for name in names:
            check_known(name, known, f"{where}: {key}: no column", ConfigError)
    for column, word in product(table.shown, product(*table.each.values())):
        try:
            name = column.name.format_map(dict(zip(table.each, word, strict=True)))
        except (KeyError, ValueError):
            raise ConfigError(
                f"{where}: columns: {column.name!r}: {{NAME}} must be one of each = "
                f"{list(table.each)}"
            ) from None
        check_known(name, known, f"{where}: columns: no column", ConfigError)
        if column.how != "value" and not pd.api.types.is_numeric_dtype(frame[name]):
            raise ConfigError(f"{where}: columns: {name} is text: only how = 'value' shows it")
        if column.how == "most_per_hour":
            check_known("time_s", known, f"{where}: most_per_hour: no column", ConfigError)


def markdown(table: TextTable) -> str:
    """Return a table in Markdown, with its title and its note before it."""
    above = " ".join(
        part for part in (f"**{table.title}.**" * bool(table.title), table.note) if part
    )
    lines = [table.head, ["---"] * len(table.head), *table.rows]
    cells = ((cell.replace("|", "\\|") for cell in line) for line in lines)
    body = "".join(
        f"|{''.join(f' {cell} |' if cell else ' |' for cell in line)}\n" for line in cells
    )
    return f"{above}\n\n{body}" if above else body


def to_rich(table: TextTable) -> RichTable:
    """Return a table for the terminal: the interval of a cell is below its mean."""
    shown = RichTable(title=table.title or None, caption=table.note or None, show_lines=True)
    for header in table.head:
        shown.add_column(Text(header))
    for row in table.rows:
        # a label is never interpreted as markup
        shown.add_row(*(Text(cell.replace(" (", "\n(")) for cell in row))
    return shown


def _groups(
    frame: pd.DataFrame, names: Sequence[str]
) -> Iterable[tuple[tuple[Label, ...], pd.DataFrame]]:
    if not names:
        return [((), frame)] if len(frame) else []
    groups: Iterable[tuple[tuple[Label, ...], pd.DataFrame]]
    groups = frame.groupby(list(names), sort=False, dropna=False)
    return groups


def _reference(
    frame: pd.DataFrame, table: StudyTable, values: Sequence[Label]
) -> pd.DataFrame | None:
    """Return the runs of the row to compare with; None for that row itself."""
    labels = dict(zip(table.rows, values, strict=True))
    wanted = labels | table.reference
    if wanted == labels:
        return None
    for name, value in wanted.items():
        frame = frame[frame[name] == value]
    return frame


def _by_unit(frame: pd.DataFrame, units: Sequence[str], name: str) -> dict[str, list[Any]]:
    """Return the values of a column by independent unit, without missing ones."""
    values: dict[str, list[Any]] = {}
    keys = zip(*(frame[unit] for unit in units), strict=True)
    for key, value in zip(keys, frame[name].tolist(), strict=True):
        if isinstance(value, str) or not math.isnan(value):
            values.setdefault(" / ".join(map(_label, key)), []).append(value)
    return values


def _cell(
    column: Column, name: str, group: pd.DataFrame, runs: Mapping[str, list[Any]], units: int
) -> str:
    every = [value for values in runs.values() for value in values]
    if not every:
        return "-"
    digits = column.digits
    match column.how:
        case "value":
            return ", ".join(
                value if isinstance(value, str) else f"{value:.{digits}f}"
                for value in dict.fromkeys(every)
            )
        case "sum" | "min" | "max":
            return f"{REDUCTIONS[column.how](every):.{digits}f}"
        case "most_per_hour":
            hours = math.fsum(group["time_s"]) / 3600.0
            return f"{most_per_hour(math.fsum(every), hours):.{digits}f}"
        case "share":
            shares = [fmean(values) for values in runs.values()]
            interval = (
                share_interval([share == 1.0 for share in shares])
                if {*shares} <= {0.0, 1.0}
                else mean_interval([100.0 * share for share in shares])
            )
        case _:
            interval = mean_interval([fmean(values) for values in runs.values()])
    missing = f" n = {interval.n}" if interval.n < units else ""
    return show(interval, digits) + missing + _limit(interval, name, group)


def _paired(
    column: Column,
    name: str,
    group: pd.DataFrame,
    runs: Mapping[str, list[Any]],
    base: Mapping[str, list[Any]],
) -> str:
    """Return the comparison of a row with its reference; empty for the reference itself."""
    before, after = ({unit: fmean(v) for unit, v in side.items()} for side in (base, runs))
    if before.keys().isdisjoint(after):
        return ""
    interval = PAIRED[column.how](before, after)
    assert interval is not None
    limit = _limit(interval, f"{name}_ratio", group) if column.how == "ratio" else ""
    return show(interval, column.digits) + limit


def _limit(interval: Interval, name: str, group: pd.DataFrame) -> str:
    """Return the limit of a mean, and whether the whole interval is within it."""
    if f"limit_{name}" not in group:
        return ""
    limits = {*group[f"limit_{name}"]}
    if len(limits) > 1 or math.isnan(limit := next(iter(limits))):
        return ""
    verdict = "" if interval.n < LEAST_UNITS else " ✓" if interval.high <= limit else " ✗"
    return f" ≤ {limit:g}{verdict}"


def _label(value: Label) -> str:
    return f"{value:g}" if isinstance(value, int | float) else str(value)
