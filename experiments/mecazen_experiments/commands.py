"""The commands of `mecazen experiment`; `mecazen_experiments.cli` declares their options."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeVar

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
from mecazen_experiments import report, tables
from mecazen_experiments import safety as guarding
from mecazen_experiments import table2 as paper
from mecazen_experiments import tune as search
from mecazen_experiments.config import Experiment, Settings, Tuning, experiment_path, parse_sweeps
from mecazen_experiments.executor import (
    ClusterWorkers,
    LocalWorkers,
    Progress,
    Workers,
    do_all,
    run_all,
)
from mecazen_experiments.jobs import Job, Key, Series, expand
from mecazen_experiments.run import FOLLOWING, Kind, Record, tabulate
from mecazen_experiments.store import Store

T = TypeVar("T")

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in a shell: 128 and the signal's number."""
TELL_S = 60.0
"""Interval between the lines in which a long command reports its progress."""
WIDTH = 160
"""Width of the tables [characters] where the output is no terminal."""


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

    def run(self, kind: Kind[T], todo: Iterable[Series]) -> dict[Key, Record[T]]:
        """Return the records of all runs; see `run_all`."""
        return run_all(kind, _jobs(todo), self.store, self.workers, self.progress)

    def rows(self, kind: Kind[T], todo: Sequence[Series]) -> list[report.Row[T]]:
        """Return the rows of all series."""
        records = self.run(kind, todo)
        return [report.summarise(kind, one, records) for one in todo]


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
    with _session(options, "runs") as session:
        records = session.run(FOLLOWING, todo)
    rows = [report.summarise(FOLLOWING, one, records) for one in todo]
    rows = report.relate(rows, [one.case for one in todo])
    _write(options, {"rows": rows})
    if verbose:
        walked = (report.summarise_walks(FOLLOWING, one, records) for one in todo)
        rows = [row for one, more in zip(rows, walked, strict=True) for row in (one, *more)]
    console(WIDTH).print(tables.cases(rows))


def tune(options: Options, file: str) -> None:
    """Search; print and write the best settings."""
    tuning = load_table(experiment_path(file), Tuning)
    with _session(options, "trials") as session:
        do = partial(run_all, FOLLOWING, store=session.store, workers=session.workers)
        best = search.tune(tuning, do, session.progress)
    _write(options, best)
    console(WIDTH).print(tables.best(best), tables.cases(best.rows), sep="\n")


def table2(options: Options, runs: int | None) -> None:
    """Run the experiment of the paper's Table II; print and write it in that shape."""
    with _session(options, "runs") as session:
        rows = session.rows(FOLLOWING, _expand(paper.NAME, runs))
    gains = paper.gains(rows)
    _write(options, {"rows": rows, "gains": gains})
    console(WIDTH).print(*tables.table2(rows, gains), sep="\n")


def budget(options: Options, file: str, runs: int | None, walks: Path | None) -> None:
    """Run an experiment with and without an oracle; print and write the error budget."""
    todo = _expand(file, runs, walks)
    oracle = _expand(file, runs, walks, (budgets.ORACLE,))
    with _session(options, "runs") as session:
        both = session.rows(FOLLOWING, [*todo, *oracle])
        bounds = session.rows(budgets.BOUND, todo)
    parts = zip(both[: len(todo)], both[len(todo) :], bounds, strict=True)
    rows = [budgets.budget(*of_case) for of_case in parts]
    _write(options, {"rows": rows})
    console(WIDTH).print(tables.budget(rows))


def mocap(
    options: Options,
    config: capturing.MocapConfig,
    settings: Settings,
    runs: int | None,
    figures: Path | None,
) -> None:
    """Run an experiment of motion capture; print and write its scores, and draw what is seen."""
    if figures is not None:
        _make_folder("--out", figures)
    todo = capturing.expand(config, runs, settings)
    curves = {}
    with _session(options, "runs") as session:
        rows = session.rows(capturing.CAPTURE, todo)
        if figures is not None:
            shown = capturing.shown(todo)
            of = {job.key: found for job, found in do_all(capturing.curves, shown, session.workers)}
            curves = {job.row: of[job.key] for job in shown}
    _write(options, {"rows": rows})
    console(WIDTH).print(*tables.mocap(rows), sep="\n")
    if figures is not None:
        from mecazen_experiments.mocap_figures import draw  # noqa: PLC0415  # slow to import

        for file in draw(figures, rows, curves):
            typer.echo(file)


def safety(
    options: Options,
    config: guarding.SafetyConfig,
    settings: Settings,
    runs: int | None,
    films: Path | None,
) -> None:
    """Run an experiment of safety; print and write its scores, and record the first runs."""
    if films is not None:
        _make_folder("--films", films)
    todo = guarding.expand(config, runs, settings)
    with _session(options, "runs") as session:
        rows = guarding.rows_of(session.rows(guarding.SAFETY, todo))
        if films is not None:
            record = partial(guarding.film, folder=films.resolve())
            for _, file in do_all(record, [one.jobs[0] for one in todo], session.workers):
                typer.echo(file)
    _write(options, {"rows": rows})
    console(WIDTH).print(tables.safety(rows))


def fuzz(
    options: Options, seeds: Sequence[int], *, physics: bool, follower: bool, freezes: bool
) -> None:
    """Drive at random, a minute a seed; print and write what was touched.

    A line reports what was found so far each minute, and at the end, however it comes.

    Raises:
        MecazenError: Anything was touched.
    """
    settings = fuzzing.ROLLERS * physics + fuzzing.FOLLOWED * follower
    kind = fuzzing.FREEZES if freezes else fuzzing.EPISODE
    jobs = fuzzing.jobs(seeds, named_file("nexus", "robot"), settings)
    keys = [job.key for job in jobs]
    with _session(options, "minutes") as session:
        store, told = session.store, time.monotonic()

        def tell(done: int, total: int) -> None:
            nonlocal told
            session.progress(done, total)
            if time.monotonic() - told >= TELL_S:
                told = time.monotonic()
                typer.echo(fuzzing.tell(store.find(kind, keys).values()))

        try:
            run_all(kind, jobs, store, session.workers, tell)
        finally:
            done = [*store.find(kind, keys).values()]
            typer.echo(fuzzing.tell(done))
    _write(options, {"minutes": done})
    if any(one.scores.contacts for one in done):
        raise MecazenError("the robot has touched something")


def figures(out: Path, seed: int) -> None:
    """Run the paper's four cases with one seed and draw them; print the files."""
    from mecazen_experiments.figures import draw  # noqa: PLC0415  # slow to import

    _make_folder("--out", out)
    experiment = load_table(experiment_path(paper.NAME), Experiment)
    cases = [case for case in experiment.cases if case.name in paper.CASES]
    found = do_all(tabulate, _jobs(expand(cases, [seed])), LocalWorkers())
    for file in draw({job.row: table for job, table in found}, out):
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


def _jobs(todo: Iterable[Series]) -> list[Job]:
    return [job for one in todo for job in one.jobs]


@contextmanager
def _session(options: Options, what: str) -> Iterator[Session]:
    """Open the store and the workers, and show progress; Ctrl-C ends it in one line.

    Raises:
        ConfigError: There is no folder for the result, or --jobs is given for a cluster.
    """
    if options.json is not None and not options.json.absolute().parent.is_dir():
        raise ConfigError(f"--json {options.json}: no such folder")
    if options.scheduler is not None and options.jobs is not None:
        raise ConfigError("--jobs: the cluster of --scheduler has its own number of processes")
    bar = Bar(
        *(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        speed_estimate_period=600.0,  # a run takes seconds, and a trial minutes
    )
    task = bar.add_task(what, total=None)

    def progress(done: int, total: int) -> None:
        bar.update(task, completed=done, total=total)

    try:
        with closing(Store(options.store)) as store, closing(_workers(options)) as workers, bar:
            yield Session(store, workers, progress)
    except KeyboardInterrupt:
        done, total = bar.tasks[0].completed, bar.tasks[0].total or 0
        typer.echo(
            f"interrupted after {done:g} of {total:g} {what}; finished ones are kept in "
            f"{options.store}, and the same command continues from there",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None


def _workers(options: Options) -> Workers:
    if options.scheduler is not None:
        return ClusterWorkers(options.scheduler)
    return LocalWorkers(options.jobs or -1)


def _write(options: Options, result: object) -> None:
    if options.json is None:
        return
    content = msgspec.json.format(msgspec.json.encode(result)) + b"\n"
    files.write(options.json, content, "--json")
