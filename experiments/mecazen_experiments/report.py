"""Rows of an experiment: the mean of each score with its interval, and every run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import groupby
from typing import Generic, TypeVar

import msgspec

from mecazen_experiments.config import BaseCase, Case
from mecazen_experiments.jobs import Job, Key, Series
from mecazen_experiments.run import Kind, Record
from mecazen_experiments.statistics import Interval, mean_interval

T = TypeVar("T")


class RunReport(msgspec.Struct, Generic[T], frozen=True):
    """A run of a row."""

    walk: str | None
    """The recorded walk that was given for it, if one was."""
    record: Record[T]


class Row(msgspec.Struct, Generic[T], frozen=True, omit_defaults=True):
    """A case, a place or a situation, and its runs."""

    name: str
    means: dict[str, Interval]
    """By score, over those runs that have it; of all walks, each counted the same."""
    runs: tuple[RunReport[T], ...] = ()
    labels: Mapping[str, str | float] = {}
    sums: dict[str, float] = {}
    least: dict[str, float | None] = {}
    published: dict[str, float] = {}
    limits: dict[str, float] = {}
    within_limits: bool | None = None
    """Whether no mean is above its limit; None without limits."""
    d_err_ratio: float | None = None
    """Mean D_err relative to that of the case's reference."""


def summarise(kind: Kind[T], series: Series, records: Mapping[Key, Record[T]]) -> Row[T]:
    """Return the row of a series."""
    case = series.case
    found = _row(kind, series.row, _runs(series.jobs, records), series.labels)
    return msgspec.structs.replace(
        found,
        published=case.published,
        limits=case.limits,
        within_limits=within(found.means, case.limits),
    )


def summarise_walks(
    kind: Kind[T], series: Series, records: Mapping[Key, Record[T]]
) -> list[Row[T]]:
    """Return a row for each recorded walk of a series; none if it was given none."""
    return [
        _row(kind, f"{series.row} / {walk}", _runs(jobs, records), {})
        for walk, jobs in groupby(series.jobs, lambda job: job.walk)
        if walk
    ]


def regroup(
    kind: Kind[T], rows: Iterable[Row[T]], names: Callable[[Row[T]], Mapping[str, str | float]]
) -> list[Row[T]]:
    """Return a row for each value of `names`, with the runs of all rows that have it."""
    groups: dict[tuple[tuple[str, str | float], ...], list[RunReport[T]]] = {}
    for row in rows:
        groups.setdefault(tuple(names(row).items()), []).extend(row.runs)
    return [
        _row(kind, ", ".join(str(value) for _, value in labels), tuple(runs), dict(labels))
        for labels, runs in groups.items()
    ]


def relate(rows: Sequence[Row[T]], cases: Sequence[BaseCase]) -> list[Row[T]]:
    """Return rows with their D_err relative to that of the reference of each one's case."""
    d_err = {row.name: row.means.get("d_err_m") for row in rows}
    return [_related(row, case, d_err) for row, case in zip(rows, cases, strict=True)]


def _related(row: Row[T], case: BaseCase, d_err: Mapping[str, Interval | None]) -> Row[T]:
    if not isinstance(case, Case) or case.reference is None:
        return row
    own, other = d_err[row.name], d_err.get(case.reference)
    if own is None or other is None:
        return row
    ratio, meets = own.mean / other.mean, row.within_limits
    if case.max_ratio is not None:
        meets = meets is not False and ratio <= case.max_ratio
    return msgspec.structs.replace(row, d_err_ratio=ratio, within_limits=meets)


def _runs(jobs: Iterable[Job], records: Mapping[Key, Record[T]]) -> tuple[RunReport[T], ...]:
    return tuple(RunReport(job.walk, records[job.key]) for job in jobs)


def _row(
    kind: Kind[T], name: str, runs: tuple[RunReport[T], ...], labels: Mapping[str, str | float]
) -> Row[T]:
    values = columns(kind.numbers(run.record.scores) for run in runs)
    means = {
        score: mean_interval(of)
        for score, of in values.items()
        if score not in (*kind.sums, *kind.least)
    }
    sums = {score: sum(values.get(score, ())) for score in kind.sums}
    least = {score: min(values.get(score, ()), default=None) for score in kind.least}
    return Row(name, means, runs, labels, sums, least)


def columns(scores: Iterable[Mapping[str, float | None]]) -> dict[str, list[float]]:
    """Return the values of each score, of those runs that have it."""
    found: dict[str, list[float]] = {}
    for numbers in scores:
        for name, value in numbers.items():
            if value is not None:
                found.setdefault(name, []).append(value)
    return found


def within(means: Mapping[str, Interval], limits: Mapping[str, float]) -> bool | None:
    """Return whether no mean is above its limit; one that is missing is not within it."""
    if not limits:
        return None
    return all(name in means and means[name].mean <= limit for name, limit in limits.items())
