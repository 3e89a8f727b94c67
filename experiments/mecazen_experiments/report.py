"""Kinds of experiments, and their rows: the mean of each score with its interval, and every run.

Runs of the same recorded walk are similar, and so are runs of one case and seed from several views.
So an interval is over such groups with equal weights, not over runs.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from itertools import chain, groupby
from pathlib import Path
from statistics import fmean
from typing import Any, Generic, NamedTuple, TypeVar

import msgspec
from rich.table import Table

from mecazen_experiments.config import Case
from mecazen_experiments.jobs import Job, Key, Series
from mecazen_experiments.statistics import (
    LEAST_UNITS,
    Interval,
    mean_interval,
    paired_ratio,
    share_interval,
)

T = TypeVar("T")

RATIO = "d_err_ratio"
"""The name of the limit on D_err relative to that of the reference."""


class Record(msgspec.Struct, Generic[T], frozen=True):
    """The scores of a run, and its cost."""

    key: Key
    trajectory_sha256: str
    scores: T
    wall_s: float
    """Wall time from loading the scenario to the last score."""
    peak_rss_mb: float
    """The peak memory of the worker so far, including earlier runs."""


class RunReport(msgspec.Struct, Generic[T], frozen=True):
    """A run of a row."""

    walk: str | None
    """The recorded walk that was given for it, if one was."""
    case: str
    record: Record[T]

    @property
    def draw(self) -> str:
        """The walk, or the seed if there is no walk."""
        return self.walk or str(self.record.key.seed)

    @property
    def unit(self) -> tuple[str, str]:
        """The group of the run: runs of other groups are independent of it."""
        return self.case, self.draw


class Row(msgspec.Struct, Generic[T], frozen=True, omit_defaults=True):
    """A case in one combination of the grid and the sweeps, and its runs."""

    name: str
    means: dict[str, Interval]
    """Means by score, over the independent units that have the score."""
    runs: tuple[RunReport[T], ...] = ()
    labels: Mapping[str, str | float] = {}
    sums: dict[str, float] = {}
    least: dict[str, float | None] = {}
    published: dict[str, float] = {}
    limits: dict[str, float] = {}
    within_limits: bool | None = None
    """Whether no interval exceeds its limit; None without limits, or with few units."""
    d_err_ratio: Interval | None = None
    """Mean D_err relative to that of the case's reference."""

    @property
    def units(self) -> int:
        """The number of independent units among the runs."""
        return len({run.unit for run in self.runs})


def no_tables(_: Sequence[Row[Any]]) -> Sequence[Table]:
    """Return no tables, for kinds that a command shows in another way."""
    return ()


Do = Callable[[Callable[[Job], Any], Sequence[Job]], Generator[tuple[Job, Any], None, None]]
"""Does some work for each job, and yields the results as they finish."""


class Kind(NamedTuple, Generic[T]):
    """A kind of experiment: how a run is measured, and how the scores of several runs are shown."""

    name: str
    """Name in the store."""
    record: type[Record[T]]
    measure: Callable[[Job], tuple[T, str]]
    """Simulates a job; returns its scores and the hash of its trajectory."""
    numbers: Callable[[T], Mapping[str, float | None]]
    """Returns the scores by name; None if there is nothing to measure."""
    tables: Callable[[Sequence[Row[T]]], Sequence[Table]] = no_tables
    draw: Callable[[Path, Sequence[Series], Sequence[Row[T]], Do], Sequence[Path]] | None = None
    """Writes figures into a folder, and returns the files."""
    export: Callable[[Path, Job], Sequence[Path]] | None = None
    """Simulates a job, writes files for gait laboratories into a folder, and returns the files."""
    sums: Sequence[str] = ()
    """Scores that are added over runs; others are averaged."""
    least: Sequence[str] = ()
    """Scores of which the minimum over runs is shown."""
    successes: Sequence[str] = ()
    """Scores that are 0 or 100 in a run, whose mean is a share of successes [%].

    If all runs of each unit agree, the interval is exact; otherwise it is over the units' shares.
    """
    cases: Sequence[str] = ()
    """Names of the cases that the tables need."""


def summarise(kind: Kind[T], series: Series, records: Mapping[Key, Record[T]]) -> Row[T]:
    """Return the row of a series."""
    case = series.case
    found = _row(kind, series.row, _runs(case, series.jobs, records), series.labels)
    return msgspec.structs.replace(
        found,
        published=case.published,
        limits=case.limits,
        within_limits=within(found.means, case.limits),
    )


def summarise_walks(
    kind: Kind[T], series: Series, records: Mapping[Key, Record[T]]
) -> list[Row[T]]:
    """Return a row for each recorded walk of a series; none without recorded walks."""
    return [
        _row(kind, f"{series.row} / {walk}", _runs(series.case, jobs, records), {})
        for walk, jobs in groupby(series.jobs, lambda job: job.walk)
        if walk
    ]


def regroup(
    kind: Kind[T], rows: Iterable[Row[T]], names: Callable[[Row[T]], Mapping[str, str | float]]
) -> list[Row[T]]:
    """Return a row for each value of `names`, with the runs of all rows that have this value."""
    groups: dict[tuple[tuple[str, str | float], ...], list[RunReport[T]]] = {}
    for row in rows:
        groups.setdefault(tuple(names(row).items()), []).extend(row.runs)
    return [
        _row(kind, ", ".join(str(value) for _, value in labels), tuple(runs), dict(labels))
        for labels, runs in groups.items()
    ]


def relate(kind: Kind[T], rows: Sequence[Row[T]], todo: Sequence[Series]) -> list[Row[T]]:
    """Return rows with their D_err relative to that of the reference of their case."""

    def by_draw(row: Row[T]) -> dict[str, float]:
        found = _by_unit(kind, row.runs).get("d_err_m", {})
        return {draw: fmean(values) for (_, draw), values in found.items()}

    known = {row.name: row for row in rows}
    related = []
    for row, (_, case, *_) in zip(rows, todo, strict=True):
        reference = known.get(case.reference or "")
        ratio = None if reference is None else paired_ratio(by_draw(reference), by_draw(row))
        if ratio is not None:
            limit = {} if case.max_ratio is None else {RATIO: case.max_ratio}
            limits = {**row.limits, **limit}
            meets = within({**row.means, RATIO: ratio}, limits)
            row = msgspec.structs.replace(  # noqa: PLW2901
                row, d_err_ratio=ratio, limits=limits, within_limits=meets
            )
        related.append(row)
    return related


def within(means: Mapping[str, Interval], limits: Mapping[str, float]) -> bool | None:
    """Return whether all scores meet their limits, see `meets`; None if unknown."""
    found = {meets(means.get(name), limit) for name, limit in limits.items()}
    if False in found:
        return False
    return None if not found or None in found else True


def meets(found: Interval | None, limit: float) -> bool | None:
    """Return whether no part of an interval is above a limit.

    A missing score does not meet the limit. The result is None for fewer than `LEAST_UNITS` units.
    """
    if found is None:
        return False
    return None if found.n < LEAST_UNITS else found.high <= limit


def _runs(
    case: Case, jobs: Iterable[Job], records: Mapping[Key, Record[T]]
) -> tuple[RunReport[T], ...]:
    return tuple(RunReport(job.walk, case.name, records[job.key]) for job in jobs)


def _by_unit(
    kind: Kind[T], runs: Iterable[RunReport[T]]
) -> dict[str, dict[tuple[str, str], list[float]]]:
    """Return the values of each score, by independent unit."""
    values: dict[str, dict[tuple[str, str], list[float]]] = {}
    for run in runs:
        for score, value in kind.numbers(run.record.scores).items():
            if value is not None:
                values.setdefault(score, {}).setdefault(run.unit, []).append(value)
    return values


def _row(
    kind: Kind[T], name: str, runs: tuple[RunReport[T], ...], labels: Mapping[str, str | float]
) -> Row[T]:
    values = _by_unit(kind, runs)
    every = {score: [*chain(*of.values())] for score, of in values.items()}
    sums = {score: sum(every.get(score, ())) for score in kind.sums}
    least = {score: min(every.get(score, ()), default=None) for score in kind.least}
    by_unit = {score: [*map(fmean, of.values())] for score, of in values.items()}
    means = {
        score: share_interval([value == 100.0 for value in of])
        if score in kind.successes and {*of} <= {0.0, 100.0}
        else mean_interval(of)
        for score, of in by_unit.items()
        if score not in {*kind.sums, *kind.least}
    }
    return Row(name, means, runs, labels, sums, least)
