"""Kinds of experiments, and their rows: the mean of each score with its interval, and every run."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from itertools import chain, groupby
from pathlib import Path
from statistics import fmean
from typing import Any, Generic, NamedTuple, TypeVar

import msgspec
from rich.table import Table

from mecazen_experiments.jobs import Job, Key, Series
from mecazen_experiments.statistics import Interval, mean_interval

T = TypeVar("T")


class Record(msgspec.Struct, Generic[T], frozen=True):
    """The scores of a run, and its cost."""

    key: Key
    trajectory_sha256: str
    scores: T
    wall_s: float
    """From loading the scenario to the last score."""
    peak_rss_mb: float
    """The peak memory of the worker so far, in this run and those before it."""


class RunReport(msgspec.Struct, Generic[T], frozen=True):
    """A run of a row."""

    walk: str | None
    """The recorded walk that was given for it, if one was."""
    record: Record[T]


class Row(msgspec.Struct, Generic[T], frozen=True, omit_defaults=True):
    """A case in one combination of the grid and the sweeps, and its runs."""

    name: str
    means: dict[str, Interval]
    """By score, over those runs that have it; with recorded walks, over the walks.

    Several seeds of a walk are not independent of each other: a walk counts by its mean."""
    runs: tuple[RunReport[T], ...] = ()
    labels: Mapping[str, str | float] = {}
    sums: dict[str, float] = {}
    least: dict[str, float | None] = {}
    published: dict[str, float] = {}
    limits: dict[str, float] = {}
    within_limits: bool | None = None
    """Whether every interval is below its limit; None without limits."""
    d_err_ratio: float | None = None
    """Mean D_err relative to that of the case's reference."""


def no_tables(_: Sequence[Row[Any]]) -> Sequence[Table]:
    """Show nothing: what a command shows in its own way."""
    return ()


Do = Callable[[Callable[[Job], Any], Sequence[Job]], Generator[tuple[Job, Any], None, None]]
"""Does some work for each job, and yields the results as they are done."""


class Kind(NamedTuple, Generic[T]):
    """A kind of experiment: how a run is measured, and how the scores of several are shown."""

    name: str
    """In the store."""
    record: type[Record[T]]
    measure: Callable[[Job], tuple[T, str]]
    """Simulates a job; returns its scores and the hash of its trajectory."""
    numbers: Callable[[T], Mapping[str, float | None]]
    """Returns the scores by name; None where there is nothing to measure."""
    tables: Callable[[Sequence[Row[T]]], Sequence[Table]] = no_tables
    draw: Callable[[Path, Sequence[Series], Sequence[Row[T]], Do], Sequence[Path]] | None = None
    """Writes figures into a folder, and returns the files."""
    export: Callable[[Path, Job], Sequence[Path]] | None = None
    """Simulates a job, writes what laboratories open into a folder, and returns the files."""
    sums: Sequence[str] = ()
    """Scores that are added over runs; others are averaged."""
    least: Sequence[str] = ()
    """Scores of which the smallest counts."""


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


def relate(rows: Sequence[Row[T]], todo: Sequence[Series]) -> list[Row[T]]:
    """Return rows with their D_err relative to that of the reference of each one's case."""
    d_err = {row.name: row.means.get("d_err_m") for row in rows}
    related = []
    for row, (_, case, *_) in zip(rows, todo, strict=True):
        own, other = d_err[row.name], d_err.get(case.reference or "")
        if own is None or other is None:
            related.append(row)
            continue
        ratio, meets = own.mean / other.mean, row.within_limits
        if case.max_ratio is not None:
            meets = meets is not False and ratio <= case.max_ratio
        related.append(msgspec.structs.replace(row, d_err_ratio=ratio, within_limits=meets))
    return related


def within(means: Mapping[str, Interval], limits: Mapping[str, float]) -> bool | None:
    """Return whether every interval is below its limit; one that is missing is not."""
    if not limits:
        return None
    return all(name in means and means[name].high <= limit for name, limit in limits.items())


def _runs(jobs: Iterable[Job], records: Mapping[Key, Record[T]]) -> tuple[RunReport[T], ...]:
    return tuple(RunReport(job.walk, records[job.key]) for job in jobs)


def _row(
    kind: Kind[T], name: str, runs: tuple[RunReport[T], ...], labels: Mapping[str, str | float]
) -> Row[T]:
    values: dict[str, dict[str | int, list[float]]] = {}
    for number, run in enumerate(runs):
        for score, value in kind.numbers(run.record.scores).items():
            if value is not None:
                values.setdefault(score, {}).setdefault(run.walk or number, []).append(value)
    sums = {score: sum(chain(*values.pop(score, {}).values())) for score in kind.sums}
    least = {
        score: min(chain(*values.pop(score, {}).values()), default=None) for score in kind.least
    }
    means = {score: mean_interval([*map(fmean, of.values())]) for score, of in values.items()}
    return Row(name, means, runs, labels, sums, least)
