"""The commands of `mecazen experiment`; `mecazen_experiments.cli` declares their options."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec
import typer
from mecazen.errors import ConfigError, MecazenError
from mecazen_tools import files
from mecazen_tools.cli.options import console
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.table import Table
from rich.text import Text

from mecazen_experiments import report
from mecazen_experiments.executor import (
    Progress,
    RunsFailedError,
    Workers,
    cluster_workers,
    do_all,
    local_workers,
    run_all,
)
from mecazen_experiments.followbench import kind as bench
from mecazen_experiments.followbench.entrants import entrant
from mecazen_experiments.followbench.episodes import read_folder
from mecazen_experiments.followbench.planners import PLANNERS
from mecazen_experiments.jobs import Key, Series
from mecazen_experiments.report import Kind, Record
from mecazen_experiments.store import Store

T = TypeVar("T")

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in a shell: 128 and the signal's number."""
TELL_S = 60.0
"""Interval between the lines in which a long command reports its progress."""
WIDTH = 160
"""Width of the tables [characters] if the output is not a terminal."""


class Options(NamedTuple):
    """The options of all commands with many runs."""

    jobs: int | None
    """Processes on this machine; None for one on each core."""
    scheduler: str | None
    """Address of a Dask scheduler to send the runs to."""
    store: Path
    json: Path | None
    """Where to write the whole result."""


class Session(NamedTuple):
    """The store, the workers and the progress bar of a command."""

    store: Store
    workers: Workers
    progress: Progress
    failed: list[RunsFailedError]
    """Failures of runs whose commands have other results to report first."""

    def run(
        self, kind: Kind[T], todo: Sequence[Series]
    ) -> tuple[list[Series], dict[Key, Record[T]], list[report.Row[T]]]:
        """Return the series with all runs that succeed, the records and the rows; see `run_all`.

        Raises:
            RunsFailedError: No run succeeds.
        """
        jobs = [job for one in todo for job in one.jobs]
        try:
            records = run_all(kind, jobs, self.store, self.workers, self.progress)
        except RunsFailedError as error:
            self.failed.append(error)
            if not (records := self.store.find(kind, [job.key for job in jobs])):
                raise
        kept = [
            one._replace(jobs=tuple(job for job in one.jobs if job.key in records)) for one in todo
        ]
        kept = [one for one in kept if one.jobs]
        return kept, records, [report.summarise(kind, one, records) for one in kept]

    def show(self, tables: Sequence[Table], written: Sequence[Path]) -> None:
        """Print tables and the names of files, then see `check`."""
        console(WIDTH).print(*tables, sep="\n")
        for file in written:
            typer.echo(file)
        self.check()

    def check(self) -> None:
        """Raise the errors of the runs that failed, after the others are reported."""
        if self.failed:
            raise MecazenError("\nerror: ".join(map(str, self.failed)))


def followbench(
    options: Options,
    followers: Sequence[str],
    *,
    folder: Path | None,
    episodes: int,
    seed: int,
    only: Sequence[str],
    own_robot: bool,
    figures: Path | None,
    films: Path | None,
) -> None:
    """Play Follow-Bench's episodes, or generated ones like them; print and write the tables."""
    for option, into in (("--figures", figures), ("--films", films)):
        if into is not None and own_robot:
            raise ConfigError(f"{option}: there are none of --own-robot")
        if into is not None:
            files.make_folder(into, option)
    if own_robot and followers:
        raise ConfigError("--follower: the robot of --own-robot has its own follower")
    followers = followers or tuple(PLANNERS)
    for name in followers:
        entrant(name)  # reports an unknown follower before the first episode
    kind: Kind[Any] = bench.OWN_ROBOT if own_robot else bench.FOLLOWBENCH
    names = [bench.OURS] if own_robot else followers
    if folder is not None:
        found, problems = read_folder(folder)
        for problem in problems:
            typer.echo(f"left out: {problem}", err=True)
        todo = bench.read_from(names, found, only)
    else:
        todo = bench.drawn(names, range(seed, seed + episodes), only)
    written: list[Path] = []
    with _session(options, "episodes") as session:
        todo, _, rows = session.run(kind, todo)
        with _reporting(options, {"rows": rows}):
            tables = kind.tables(rows)
            _write(options, {"rows": rows}, tables)
            if figures is not None:
                written += bench.draw(figures, rows)
            if films is not None:
                record = partial(bench.film_of, films)
                worst = [bench.worst(*one) for one in zip(todo, rows, strict=True)]
                written += [file for _, file in do_all(record, worst, session.workers)]
    session.show(tables, written)


def leaderboard(results: Sequence[Path], figures: Path | None) -> None:
    """Print one table of the results of several entries, and draw its figure."""
    rows = [row for file in results for row in bench.rows_of(file)]
    console(WIDTH).print(*bench.FOLLOWBENCH.tables(rows), sep="\n")
    if figures is not None:
        files.make_folder(figures, "--figures")
        for file in bench.draw(figures, rows):
            typer.echo(file)


@contextmanager
def _session(options: Options, what: str) -> Iterator[Session]:
    """Open the store and the workers, and show progress; Ctrl-C ends it in one line."""
    if options.json is not None and not options.json.absolute().parent.is_dir():
        raise ConfigError(f"--json {options.json}: no such folder")
    if options.scheduler is not None and options.jobs is not None:
        raise ConfigError("--jobs: the cluster of --scheduler has its own number of processes")
    terminal = Console(stderr=True)
    bar = Bar(
        *(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()),
        TimeRemainingColumn(),
        console=terminal,
        transient=True,
        disable=not terminal.is_terminal,  # it would leave an empty line
        speed_estimate_period=600.0,  # a run takes seconds, and a trial minutes
    )
    task = bar.add_task(what, total=None)

    def progress(done: int, total: int) -> None:
        bar.update(task, completed=done, total=total)

    try:
        with closing(Store(options.store)) as store, _workers(options) as workers, bar:
            yield Session(store, workers, progress, [])
    except KeyboardInterrupt:
        done, total = bar.tasks[0].completed, bar.tasks[0].total or 0
        typer.echo(
            f"interrupted after {done:g} of {total:g} {what}; finished ones are kept in "
            f"{options.store}, and the same command continues from there",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None


@contextmanager
def _reporting(options: Options, result: Mapping[str, object]) -> Iterator[None]:
    """Write a result and print its place before its report is made."""
    _write(options, result)
    places = " and ".join(str(file) for file in (options.store, options.json) if file)
    typer.echo(f"results: {places}", err=True)
    try:
        yield
    except OSError as error:
        raise MecazenError(f"no report: {error}") from error


def _workers(options: Options) -> AbstractContextManager[Workers]:
    if options.scheduler is not None:
        return cluster_workers(options.scheduler)
    return nullcontext(local_workers(options.jobs or -1))


def plain(table: Table) -> dict[str, object]:
    """Return a table without styles; the second line of a cell is put in brackets."""

    def text(content: object) -> str:
        return content.plain if isinstance(content, Text) else Text.from_markup(str(content)).plain

    def cell(content: object) -> str:
        first, _, second = text(content).partition("\n")
        return f"{first} ({second.replace(' … ', '–')})" if second else first

    rows = zip(*(column.cells for column in table.columns), strict=True)
    return {
        "title": text(table.title or ""),
        "caption": text(table.caption or ""),
        "head": [text(column.header).replace("\n", " ") for column in table.columns],
        "rows": [[cell(content) for content in row] for row in rows],
    }


def _write(options: Options, result: Mapping[str, object], tables: Sequence[Table] = ()) -> None:
    if options.json is None:
        return
    content = {**result, "tables": [plain(table) for table in tables]}
    files.write(options.json, msgspec.json.format(msgspec.json.encode(content)) + b"\n", "--json")
