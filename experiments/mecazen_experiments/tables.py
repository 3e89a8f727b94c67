"""Tables of a study: rows of runs, means over independent units, and their 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import product
from statistics import fmean, median
from typing import NamedTuple

import numpy as np
import pandas as pd
from mecazen.errors import ConfigError
from mecazen_tools.statistics import LEAST_UNITS, Interval, mean_interval, show
from msgspec.structs import replace
from rich.table import Table as RichTable
from rich.text import Text
from scipy.stats import binomtest, chi2

from mecazen_experiments.frame import select
from mecazen_experiments.study import Column, Label, Study, StudyTable, check_known

REDUCTIONS: dict[str, Callable[[list[float]], float]] = {
    "sum": math.fsum,
    "min": min,
    "median": median,
    "p90": lambda values: float(np.percentile(values, 90.0)),
    "max": max,
}
CAPTION = "Means with 95 % intervals over the n independent units; for two units, both values."
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
    selected = select(frame, table.where, f"table {table.title!r}: where")
    rows = []
    for values, group in _groups(selected, table.rows):
        units = group.groupby(list(table.unit), sort=False, dropna=False).ngroups
        count = f"{units}" if units == len(group) else f"{units} ({len(group)} runs)"
        reference = _reference(frame, table, values)
        for word in product(*table.each.values()):
            cells = []
            for column in table.columns:
                name = column.name.format_map(dict(zip(table.each, word, strict=True)))
                if column.how in ("difference", "ratio"):
                    cells.append(_paired(column, name, group, reference, table.unit))
                else:
                    cells.append(_cell(column, name, group, table.unit, units))
            rows.append((*word, *map(_label, values), count, *cells))
    head = (*table.each, *table.rows, "n", *(column.header for column in table.columns))
    notes = [table.note] if table.note else []
    if {column.how for column in table.columns} & {"mean", "share", "difference", "ratio"}:
        notes.append(CAPTION)
    if any(cell.endswith(("✓", "✗")) for row in rows for cell in row):
        notes.append(VERDICT)
    return TextTable(table.title, head, rows, " ".join(notes))


def unit_means(
    frame: pd.DataFrame, unit: Sequence[str], name: str
) -> dict[tuple[Label, ...], float]:
    """Return the mean of a column by independent unit, without missing values."""
    values: dict[tuple[Label, ...], list[float]] = {}
    keys = zip(*(frame[part].tolist() for part in unit), strict=True)
    for key, value in zip(keys, frame[name].tolist(), strict=True):
        if not math.isnan(value):
            values.setdefault(key, []).append(value)
    return {key: fmean(numbers) for key, numbers in values.items()}


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
        for key, names in (("x", [figure.x]), ("y", figure.y), ("by", [figure.by])):
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
    for key, names in (("rows", table.rows), ("unit", table.unit)):
        for name in names:
            check_known(name, known, f"{where}: {key}: no column", ConfigError)
    for column, word in product(table.columns, product(*table.each.values())):
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
    title = f"**{table.title}.**" if table.title else ""
    above = " ".join(filter(None, (title, table.note)))
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


def share_interval(successes: Sequence[bool]) -> Interval:
    """Return the share of successes [%] with its exact interval (Clopper and Pearson 1934)."""
    test = binomtest(sum(map(bool, successes)), len(successes))
    limits = test.proportion_ci(0.95, method="exact")
    mean, low, high = (100.0 * float(share) for share in (test.statistic, *limits))
    return Interval(mean, low, high, test.n)


def most_per_hour(events: float, hours: float) -> float:
    """Return the upper limit of the rate of rare events, with 95 % confidence [1/h].

    The limit is that of Garwood for the Poisson distribution (Biometrika 28, 1936): 3.0 / hours
    without events.
    """
    return float(chi2.ppf(0.95, 2.0 * (events + 1.0))) / 2.0 / hours


def _groups(
    frame: pd.DataFrame, names: Sequence[str]
) -> Iterable[tuple[tuple[Label, ...], pd.DataFrame]]:
    if not names:
        return [((), frame)] if len(frame) else []
    groups: Iterable[tuple[tuple[Label, ...], pd.DataFrame]]
    groups = frame.groupby(list(names), sort=False, dropna=False)
    return groups


def _reference(frame: pd.DataFrame, table: StudyTable, values: Sequence[Label]) -> pd.DataFrame:
    """Return the runs of the row to compare with; none for that row itself."""
    labels: dict[str, Label] = dict(zip(table.rows, values, strict=True))
    if labels == labels | table.reference:
        return frame[:0]
    for name, value in (labels | table.reference).items():
        frame = frame[frame[name] == value]
    return frame


def _cell(column: Column, name: str, group: pd.DataFrame, unit: Sequence[str], units: int) -> str:
    values, digits = group[name].dropna().tolist(), column.digits
    if not values:
        return "-"
    match column.how:
        case "value":
            shown = (value if isinstance(value, str) else f"{value:.{digits}f}" for value in values)
            return ", ".join(dict.fromkeys(shown))
        case "sum" | "min" | "median" | "p90" | "max":
            return f"{REDUCTIONS[column.how](values):.{digits}f}"
        case "most_per_hour":
            hours = math.fsum(group["time_s"]) / 3600.0
            return f"{most_per_hour(math.fsum(values), hours):.{digits}f}"
    means = [*unit_means(group, unit, name).values()]
    if column.how == "mean":
        interval = mean_interval(means)
    elif {*means} <= {0.0, 1.0} and len(means) != 2:  # of two units, both values are shown
        interval = share_interval([mean == 1.0 for mean in means])
    else:
        interval = mean_interval([100.0 * mean for mean in means])
        if interval.n > 2:  # of two units, the values are shown
            low, high = max(interval.low, 0.0), min(interval.high, 100.0)
            interval = replace(interval, low=low, high=high)
    missing = f" n = {interval.n}" if interval.n < units else ""
    return show(interval, digits) + missing + _limit(interval, name, group)


def _paired(
    column: Column, name: str, group: pd.DataFrame, reference: pd.DataFrame, unit: Sequence[str]
) -> str:
    """Return the comparison with a reference, unit by unit; empty for the reference itself.

    Effects of a unit on both, such as the noise of its seed, cancel.
    """
    before, after = (unit_means(runs, unit, name) for runs in (reference, group))
    pairs = [(before[key], after[key]) for key in after if key in before]
    if not pairs:
        return ""
    if column.how == "difference":
        return show(mean_interval([b - a for a, b in pairs]), column.digits)
    interval = mean_interval([b / a for a, b in pairs])
    return show(interval, column.digits) + _limit(interval, f"{name}_ratio", group)


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
