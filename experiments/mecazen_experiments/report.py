"""The report of an experiment: the mean of each score with its interval, and every run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby

import msgspec
from rich.table import Column, Table
from rich.text import Text

from mecazen_experiments.config import BaseCase, Case
from mecazen_experiments.jobs import Job, Key, Series
from mecazen_experiments.run import Record
from mecazen_experiments.scores import Score
from mecazen_experiments.statistics import Interval, mean_interval

CAPTION = "means over the runs, below each its 95 % interval"

Means = dict[str, Interval | None]
"""By the names of `Score`; None where no run has the score."""


class Run(msgspec.Struct, frozen=True):
    """A run of a row."""

    walk: str | None
    """The recorded walk that was given for it, if one was."""
    record: Record


class Row(msgspec.Struct, frozen=True):
    """A case, or one combination of its sweep."""

    name: str
    published: dict[str, float]
    limits: dict[str, float]
    within_limits: bool | None
    """Whether no mean is above its limit; None without limits."""
    whole: Means
    """Over the runs of all walks, each counted the same."""
    settled: Means
    runs: tuple[Run, ...]
    d_err_ratio: float | None = None
    """Mean D_err relative to that of the case's reference."""


def summarise(series: Series, records: Mapping[Key, Record]) -> Row:
    """Return the row of a series."""
    return _row(series.row, series.case, series.jobs, records)


def summarise_walks(series: Series, records: Mapping[Key, Record]) -> list[Row]:
    """Return a row for each recorded walk of a series; none if it was given none."""
    return [
        _row(f"{series.row} / {walk}", series.case, tuple(jobs), records)
        for walk, jobs in groupby(series.jobs, lambda job: job.walk)
        if walk
    ]


def relate(rows: Sequence[Row], cases: Sequence[BaseCase]) -> list[Row]:
    """Return rows with their D_err relative to that of the reference of each one's case."""
    d_err = {row.name: row.whole["d_err_m"] for row in rows}
    return [_related(row, case, d_err) for row, case in zip(rows, cases, strict=True)]


def _related(row: Row, case: BaseCase, d_err: Means) -> Row:
    reference = case.reference if isinstance(case, Case) else None
    own, other = row.whole["d_err_m"], d_err.get(reference or "")
    if not isinstance(case, Case) or own is None or other is None:
        return row
    ratio, meets = own.mean / other.mean, row.within_limits
    if case.max_ratio is not None:
        meets = meets is not False and ratio <= case.max_ratio
    return msgspec.structs.replace(row, d_err_ratio=ratio, within_limits=meets)


def _row(name: str, case: BaseCase, jobs: Sequence[Job], records: Mapping[Key, Record]) -> Row:
    runs = tuple(Run(job.walk, records[job.key]) for job in jobs)
    whole = means([run.record.scores.whole for run in runs])
    settled = means([run.record.scores.settled for run in runs])
    meets = within(whole, case.limits)
    return Row(name, case.published, case.limits, meets, whole, settled, runs)


def means(scores: Sequence[Score]) -> Means:
    """Return the mean of every score over those runs that have it."""
    columns = {
        name: [value for score in scores if (value := getattr(score, name)) is not None]
        for name in Score.__struct_fields__
    }
    return {name: mean_interval(values) if values else None for name, values in columns.items()}


def within(found: Means, limits: Mapping[str, float]) -> bool | None:
    """Return whether no mean is above its limit; one that is missing is not within it."""
    if not limits:
        return None
    return all((mean := found[name]) and mean.mean <= limit for name, limit in limits.items())


def table(rows: Sequence[Row]) -> Table:
    """Return the rows as a table, each mean above its 95 % interval."""
    parts, errors = ("whole", "settled"), {"D_err \\[m]": "d_err_m", "Θ_err \\[°]": "theta_err_deg"}
    titles = (f"{part}\n{error}" for part in parts for error in errors)
    shown = Table(Column("case", overflow="fold"), "runs", show_lines=True, caption=CAPTION)
    for title in (
        *titles,
        "estimate\nyaw \\[°]",
        "NEES",
        "lost \\[s]",
        "of the\nreference",
        "limits",
    ):
        shown.add_column(title)
    for row in rows:
        shown.add_row(
            Text(row.name),  # not markup, whatever it is
            str(len(row.runs)),
            *(
                show(means[score], 4 if score.endswith("_m") else 2)
                for means in (row.whole, row.settled)
                for score in errors.values()
            ),
            show(row.whole["estimate_yaw_err_deg"], 2),
            show(row.whole["nees"], 2),
            show(row.whole["lost_s"], 2),
            "" if row.d_err_ratio is None else f"{row.d_err_ratio:.2f}",
            {None: "", True: "[green]✓[/]", False: "[red]✗[/]"}[row.within_limits],
        )
    return shown


def show(interval: Interval | None, digits: int) -> str:
    """Return a mean and, in a line of its own, its interval."""
    if interval is None:
        return "-"
    return "{0:.{3}f}\n[dim]{1:.{3}f} … {2:.{3}f}[/]".format(
        interval.mean, interval.low, interval.high, digits
    )
