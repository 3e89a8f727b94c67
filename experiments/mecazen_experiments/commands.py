"""The commands of `mecazen experiment`; `mecazen_experiments.cli` declares their options."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec
import typer
from mecazen.errors import ConfigError, MecazenError
from mecazen.loading import load_table, named_file
from mecazen_tools import files
from mecazen_tools.cli.options import console
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from mecazen_experiments import budget as budgets
from mecazen_experiments import fuzz as fuzzing
from mecazen_experiments import mocap as capturing
from mecazen_experiments import report
from mecazen_experiments import safety as guarding
from mecazen_experiments import table2 as paper
from mecazen_experiments import tune as search
from mecazen_experiments.config import Experiment, Settings, Tuning, experiment_path, parse_sweeps
from mecazen_experiments.jobs import Job, Key, Series, expand
from mecazen_experiments.local import LocalWorkers
from mecazen_experiments.quality import Curves, Quality
from mecazen_experiments.run import Record, tabulate
from mecazen_experiments.schedule import Progress, Workers, do_all, do_new, run_all
from mecazen_experiments.store import R, Records, Store
from mecazen_experiments.table import Table

INTERRUPTED = 130
"""Exit code after Ctrl-C, as of a shell: 128 and the signal's number."""
TELL_S = 60.0
"""So often a long command says what came of it so far."""
WIDTH = 160
"""Of the tables [characters] where the output is no terminal."""


class Options(NamedTuple):
    """The options of all commands with many runs."""

    jobs: int | None
    """Processes on this machine; None for one on each core."""
    scheduler: str | None
    """Address of a Dask scheduler to send the runs to."""
    store: Path
    json: Path | None
    """Where to write the whole result."""


class Wanted(NamedTuple):
    """What of an experiment of motion capture to run; empty is all."""

    views: Sequence[str]
    standoffs_m: Sequence[float]
    speeds_m_s: Sequence[float]
    settings: Settings
    runs: int | None


def run(
    options: Options,
    files: Sequence[str],
    settings: Settings,
    sweeps: Sequence[str],
    walks: Path | None,
    runs: int | None,
    *,
    verbose: bool,
) -> None:
    """Run experiments; print and write one report."""
    swept = parse_sweeps(sweeps)
    todo = [one for file in files for one in _expand(file, runs, walks, settings, swept)]
    names = Counter(one.row for one in todo)
    if twice := [name for name, count in names.items() if count > 1]:
        raise ConfigError(f"{' and '.join(files)}: more than one case {twice[0]!r}")
    with _session(options, "runs") as (store, workers, progress):
        records = run_all(_jobs(todo), store, workers, progress)
    rows = [report.summarise(one, records) for one in todo]
    rows = report.relate(rows, [one.case for one in todo])
    _write(options, {"rows": rows})
    if verbose:
        walked = (report.summarise_walks(one, records) for one in todo)
        rows = [row for one, more in zip(rows, walked, strict=True) for row in (one, *more)]
    console(WIDTH).print(report.table(rows))


def tune(options: Options, file: str) -> None:
    """Search; print and write the best settings."""
    tuning = load_table(experiment_path(file), Tuning)
    with _session(options, "trials") as (store, workers, progress):
        best = search.tune(tuning, partial(run_all, store=store, workers=workers), progress)
    _write(options, best)
    console(WIDTH).print(search.table(best), report.table(best.rows), sep="\n")


def table2(options: Options, runs: int | None) -> None:
    """Run the experiment of the paper's Table II; print and write it in that shape."""
    todo = _expand(paper.NAME, runs)
    with _session(options, "runs") as (store, workers, progress):
        records = run_all(_jobs(todo), store, workers, progress)
    result = paper.table2(report.summarise(one, records) for one in todo)
    _write(options, result)
    console(WIDTH).print(*paper.tables(result), sep="\n")


def budget(options: Options, file: str, runs: int | None, walks: Path | None) -> None:
    """Run an experiment with and without an oracle; print and write the error budget."""
    todo = _expand(file, runs, walks)
    oracle = _expand(file, runs, walks, (budgets.ORACLE,))
    bounds = {}
    with _session(options, "runs") as (store, workers, progress):
        records = run_all(_jobs([*todo, *oracle]), store, workers, progress)
        jobs = _jobs(todo)

        def keep(job: Job, bound: budgets.Bound) -> None:
            bounds[job.key] = bound
            progress(len(bounds), len(jobs))

        do_all(budgets.bound, jobs, workers, keep)
    rows = [budgets.budget(*pair, records, bounds) for pair in zip(todo, oracle, strict=True)]
    _write(options, {"rows": rows})
    console(WIDTH).print(budgets.table(rows))


def mocap(
    file: str,
    wanted: Wanted,
    options: Options,
    draw: Callable[[Sequence[capturing.Row], Mapping[capturing.Place, Curves]], list[Path]] | None,
) -> None:
    """Run an experiment of motion capture; print and write its scores, and draw what is seen."""
    config = load_table(experiment_path(file), capturing.MocapConfig)
    config = capturing.selected(config, *wanted[:3])
    todo = capturing.expand(config, wanted.runs, wanted.settings)
    jobs = _jobs([*todo.values()])
    scores: dict[Key, Quality] = {}
    curves: dict[Key, Curves] = {}
    bar, progress = _bar(options, "runs")

    def keep(job: Job, found: tuple[Quality, Curves]) -> None:
        scores[job.key], curves[job.key] = found
        progress(len(scores), len(jobs))

    with bar, _workers(options) as workers:
        do_all(capturing.measure, jobs, workers, keep)
    rows = capturing.summarise(config, todo, scores)
    _write(options, {"rows": rows})
    console(WIDTH).print(*capturing.tables(rows), sep="\n")
    if draw is not None:
        for figure in draw(rows, {place: curves[of.jobs[0].key] for place, of in todo.items()}):
            typer.echo(figure)


def safety(
    file: str,
    wanted: Sequence[Sequence[str]],
    settings: Settings,
    runs: int | None,
    options: Options,
    films: Path | None,
) -> None:
    """Run an experiment of safety; print and write its scores, and record the first runs."""
    if films is not None:
        _make_folder("--films", films)
    config = load_table(experiment_path(file), guarding.SafetyConfig)
    todo = guarding.expand(guarding.selected(config, *wanted), runs, settings)
    opened = Records(options.store, guarding.SafetyRecord, "safety")
    with _stored(options, "runs", opened) as (store, workers, progress):
        jobs = [job for of_place in todo.values() for job in of_place]
        records = do_new(guarding.measure, jobs, store, workers, progress)
        if films is not None:
            record = partial(guarding.film, folder=films.resolve())
            first = [of_place[0] for of_place in todo.values()]
            do_all(record, first, workers, lambda _, file: typer.echo(file))
    rows = guarding.summarise(todo, records)
    _write(options, {"rows": rows})
    console(WIDTH).print(guarding.table(rows))


def fuzz(options: Options, seeds: Sequence[int], *, physics: bool) -> None:
    """Drive at random, a minute a seed; print and write what was touched.

    What came of it so far is told each minute, and however it ends.

    Raises:
        MecazenError: Anything was touched.
    """
    settings = fuzzing.ROLLERS if physics else ()
    jobs = fuzzing.jobs(seeds, named_file("nexus", "robot"), settings)
    keys = [job.key for job in jobs]
    opened = Records(options.store, fuzzing.Episode, "fuzz")
    with _stored(options, "minutes", opened) as (store, workers, progress):
        told = time.monotonic()

        def tell(done: int, total: int) -> None:
            nonlocal told
            progress(done, total)
            if time.monotonic() - told >= TELL_S:
                told = time.monotonic()
                typer.echo(fuzzing.tell(store.find(keys).values()))

        try:
            do_new(fuzzing.episode, jobs, store, workers, tell)
        finally:
            done = [*store.find(keys).values()]
            typer.echo(fuzzing.tell(done))
    _write(options, {"minutes": done})
    if any(one.contacts for one in done):
        raise MecazenError("the robot has touched something")


def figures(draw: Callable[[Mapping[str, Table], Path], list[Path]], out: Path, seed: int) -> None:
    """Run the paper's four cases with one seed and draw them; print the files."""
    _make_folder("--out", out)
    experiment = load_table(experiment_path(paper.NAME), Experiment)
    cases = [case for case in experiment.cases if case.name in paper.CASES]
    tables: dict[str, Table] = {}
    jobs = _jobs(expand(cases, [seed]))
    do_all(tabulate, jobs, LocalWorkers(), lambda job, table: tables.update({job.row: table}))
    for file in draw(tables, out):
        typer.echo(file)


def _make_folder(option: str, folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MecazenError(f"{option} {folder}: {error.strerror}") from None


def _expand(
    file: str,
    runs: int | None,
    walks: Path | None = None,
    settings: Settings = (),
    sweeps: Mapping[str, tuple[str, ...]] | None = None,
) -> list[Series]:
    """Return the runs of an experiment; see `jobs.expand`."""
    experiment = load_table(experiment_path(file), Experiment)
    files = sorted(walks.glob("*.csv")) if walks else []
    if walks and not files:
        raise ConfigError(f"--walks {walks}: no such folder, or no *.csv in it")
    seeds = range(1, (runs or experiment.seeds) + 1)
    return expand(experiment.cases, seeds, settings, sweeps, files)


def _jobs(todo: Sequence[Series]) -> list[Job]:
    return [job for one in todo for job in one.jobs]


@contextmanager
def _session(options: Options, what: str) -> Iterator[tuple[Records[Record], Workers, Progress]]:
    """Open the store of runs and the workers; see `_stored`."""
    with _stored(options, what, Store(options.store)) as session:
        yield session


@contextmanager
def _stored(
    options: Options, what: str, opened: Records[R]
) -> Iterator[tuple[Records[R], Workers, Progress]]:
    """Open the workers, and show progress; Ctrl-C ends it in one line.

    Raises:
        ConfigError: There is no folder for the result.
    """
    bar, progress = _bar(options, what)
    try:
        with closing(opened) as store, _workers(options) as workers, bar:
            yield store, workers, progress
    except KeyboardInterrupt:
        done, total = bar.tasks[0].completed, bar.tasks[0].total or 0
        typer.echo(
            f"interrupted after {done:g} of {total:g} {what}; finished ones are kept in "
            f"{options.store}, and the same command continues from there",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None


def _bar(options: Options, what: str) -> tuple[Bar, Progress]:
    """Return a bar, and what moves it.

    Raises:
        ConfigError: There is no folder for the result.
    """
    if options.json is not None and not options.json.absolute().parent.is_dir():
        raise ConfigError(f"--json {options.json}: no such folder")
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    bar = Bar(
        *(*columns, TimeRemainingColumn()),
        console=Console(stderr=True),
        transient=True,
        speed_estimate_period=600.0,  # a run takes seconds, and a trial minutes
    )
    task = bar.add_task(what, total=None)

    def progress(done: int, total: int) -> None:
        bar.update(task, completed=done, total=total)

    return bar, progress


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


def _write(options: Options, result: object) -> None:
    if options.json is None:
        return
    content = msgspec.json.format(msgspec.json.encode(result)) + b"\n"
    files.write(options.json, content, "--json")
