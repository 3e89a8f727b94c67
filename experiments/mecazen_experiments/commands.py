"""What the commands do; `mecazen_experiments.cli` is how they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec
import typer
from mecazen.errors import ConfigError, MecazenError
from mecazen.loading import load_table
from rich.console import Console, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from mecazen_experiments import report
from mecazen_experiments import shares as owed
from mecazen_experiments import table2 as paper
from mecazen_experiments import tune as search
from mecazen_experiments.config import (
    Experiment,
    Settings,
    Tuning,
    experiment_path,
    parse_sweeps,
)
from mecazen_experiments.jobs import expand
from mecazen_experiments.local import LocalWorkers
from mecazen_experiments.run import tabulate
from mecazen_experiments.schedule import Progress, run_all
from mecazen_experiments.store import Store
from mecazen_experiments.table import Table
from mecazen_experiments.workers import Done, Workers

INTERRUPTED = 130
"""Exit code after Ctrl-C, as a shell gives it: 128 and the signal's number."""
WIDTH = 140
"""Of the tables [characters] where the output is no terminal."""


class Options(NamedTuple):
    """What all commands with many runs can be told."""

    jobs: int | None
    """Processes on this machine; None for all cores."""
    scheduler: str | None
    """Address of a Dask scheduler to send the runs to."""
    store: Path
    json: Path | None
    """Where to write the whole result."""


def run(
    file: str,
    settings: Settings,
    sweeps: Sequence[str],
    walks: Path | None,
    runs: int | None,
    options: Options,
    *,
    verbose: bool,
) -> None:
    """Run an experiment; print and write its report."""
    _check(options)
    experiment = load_table(experiment_path(file), Experiment)
    todo = expand(
        experiment.cases,
        range(1, (runs or experiment.seeds) + 1),
        settings,
        parse_sweeps(sweeps),
        _csv_files(walks) if walks else (),
    )
    with _session(options, "runs") as (store, workers, progress):
        records = run_all([job for one in todo for job in one.jobs], store, workers, progress)
    rows = [report.summarise(one, records) for one in todo]
    _write(options, report.Report(tuple(rows)))
    if verbose:
        rows = [
            row
            for one, row in zip(todo, rows, strict=True)
            for row in (row, *report.summarise_walks(one, records))
        ]
    _print(report.table(rows))


def tune(file: str, options: Options) -> None:
    """Search; print and write the best."""
    _check(options)
    tuning = load_table(experiment_path(file), Tuning)
    with _session(options, "trials") as (store, workers, progress):
        best = search.tune(tuning, partial(run_all, store=store, workers=workers), progress)
    _write(options, best)
    _print(search.table(best), report.table(best.rows))


def table2(runs: int | None, options: Options) -> None:
    """Run the experiment of the paper's Table II; print and write it in that shape."""
    _check(options)
    experiment = load_table(experiment_path(paper.NAME), Experiment)
    todo = expand(experiment.cases, range(1, (runs or experiment.seeds) + 1))
    with _session(options, "runs") as (store, workers, progress):
        records = run_all([job for one in todo for job in one.jobs], store, workers, progress)
    result = paper.table2(report.summarise(one, records) for one in todo)
    _write(options, result)
    _print(*paper.tables(result))


def shares(file: str, runs: int | None, walks: Path | None, options: Options) -> None:
    """Run an experiment, and again with an oracle; print and write who owes what."""
    _check(options)
    experiment = load_table(experiment_path(file), Experiment)
    seeds = range(1, (runs or experiment.seeds) + 1)
    tracks = _csv_files(walks) if walks else ()
    best = expand(experiment.cases, seeds, walks=tracks)
    oracle = expand(experiment.cases, seeds, (owed.ORACLE,), walks=tracks)
    jobs = [job for one in best for job in one.jobs]
    with _session(options, "runs") as (store, workers, progress):
        told = [job for one in oracle for job in one.jobs]
        records = run_all(jobs + told, store, workers, progress)
        bounds = {}
        for outcome in workers.do(owed.bound, jobs):
            if not isinstance(outcome, Done):
                raise MecazenError(str(outcome))
            bounds[outcome.job.key] = outcome.value
            progress(len(bounds), len(jobs))
    rows = [owed.shares(*pair, records, bounds) for pair in zip(best, oracle, strict=True)]
    _write(options, owed.Report(tuple(rows)))
    _print(owed.table(rows))


def figures(draw: Callable[[Mapping[str, Table], Path], list[Path]], out: Path, seed: int) -> None:
    """Run the paper's four cases with one seed and have them drawn; print the files."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MecazenError(f"--out {out}: {error.strerror}") from None
    experiment = load_table(experiment_path(paper.NAME), Experiment)
    cases = [case for case in experiment.cases if case.name in paper.CASES]
    tables = {}
    for outcome in LocalWorkers().do(tabulate, [one.jobs[0] for one in expand(cases, [seed])]):
        if not isinstance(outcome, Done):
            raise MecazenError(str(outcome))
        tables[outcome.job.row] = outcome.value
    for file in draw(tables, out):
        typer.echo(file)


@contextmanager
def _session(options: Options, what: str) -> Iterator[tuple[Store, Workers, Progress]]:
    """Open the store and the workers, and show progress; Ctrl-C ends it in one line."""
    bar = Bar(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        speed_estimate_period=600.0,  # a run takes seconds, and a trial minutes
    )
    task = bar.add_task(what, total=None)

    def progress(done: int, total: int) -> None:
        bar.update(task, completed=done, total=total)

    try:
        with closing(Store(options.store)) as store, _workers(options) as workers, bar:
            yield store, workers, progress
    except KeyboardInterrupt:
        done, total = bar.tasks[0].completed, bar.tasks[0].total or 0
        typer.echo(
            f"interrupted after {done:g} of {total:g} {what}; what is finished is kept in "
            f"{options.store}, and the same command goes on from there",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None


@contextmanager
def _workers(options: Options) -> Iterator[Workers]:
    if options.scheduler is None:
        yield LocalWorkers(options.jobs or -1)
        return
    if options.jobs is not None:
        raise ConfigError("--jobs: the cluster of --scheduler has its own number of processes")
    try:
        from mecazen_experiments.cluster import ClusterWorkers  # noqa: PLC0415  # an extra
    except ModuleNotFoundError:
        raise ConfigError(
            "--scheduler needs Dask: pip install 'mecazen-experiments[cluster]'"
        ) from None
    with closing(ClusterWorkers(options.scheduler)) as workers:
        yield workers


def _csv_files(folder: Path) -> list[Path]:
    files = sorted(folder.glob("*.csv"))
    if not files:
        raise ConfigError(f"--walks {folder}: no such folder, or no *.csv in it")
    return files


def _check(options: Options) -> None:
    """Raise ConfigError now, and not after the runs, if there is no place for the result."""
    if options.json is not None and not options.json.absolute().parent.is_dir():
        raise ConfigError(f"--json {options.json}: no such folder")


def _write(options: Options, result: msgspec.Struct) -> None:
    if options.json is None:
        return
    try:
        options.json.write_bytes(msgspec.json.format(msgspec.json.encode(result)) + b"\n")
    except OSError as error:
        raise MecazenError(f"--json {options.json}: {error.strerror}") from None


def _print(*shown: RenderableType) -> None:
    console = Console()
    if not console.is_terminal:
        console = Console(width=WIDTH)
    for one in shown:
        console.print(one)
