"""`mecazen experiment run`: runs a study, and shows its tables and figures."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from pathlib import Path

import typer
from mecazen.errors import ConfigError
from mecazen_tools import files
from mecazen_tools.cli.options import console
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from mecazen_experiments import frame, tables
from mecazen_experiments.expansion import Job, expand
from mecazen_experiments.runs import (
    Columns,
    Progress,
    RunsFailedError,
    Store,
    Workers,
    cluster_workers,
    local_workers,
    run_all,
)
from mecazen_experiments.study import Study, load_study

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in a shell: 128 and the signal's number."""
WIDTH = 160
"""Width of the tables [characters] if the output is not a terminal."""


def plan(
    name: str,
    seeds: str | None,
    walks: Path | None,
    settings: Iterable[str],
    sweep: Iterable[str],
    only: Iterable[str],
) -> tuple[Study, list[Job]]:
    """Return a study and its runs; the arguments are those of the command."""
    study = load_study(name)
    recorded = sorted(walks.glob("*.csv")) if walks else []
    if walks and not recorded:
        raise ConfigError(f"--walks {walks}: no such folder, or no *.csv in it")
    sweeps = dict(map(_parse_sweep, sweep))
    return study, expand(study, _parse_seeds(seeds), tuple(settings), sweeps, recorded, only)


def run(
    study: Study,
    jobs: Sequence[Job],
    workers: AbstractContextManager[Workers],
    store: Path,
    csv: Path | None = None,
    figures: Path | None = None,
) -> None:
    """Do the runs of a study; print its tables, and write its frame and figures on demand.

    Args:
        study: The study.
        jobs: Its runs.
        workers: Who does them.
        store: The file of finished runs.
        csv: File for the frame: one row a run.
        figures: Folder for the study's figures.
    """
    _prepare(study, csv, figures)

    def check(job: Job, columns: Columns) -> None:
        tables.check(study, frame.read(study, frame.to_csv([job], {job.key: columns})))

    failure: RunsFailedError | None = None
    with _session(workers, store) as (database, active, progress):
        try:
            results = run_all(jobs, database, active, progress, check)
        except RunsFailedError as error:
            failure, results = error, database.find(job.key for job in jobs)
            if not results:
                raise
        text = frame.to_csv(jobs, results)
        if csv is not None:
            files.write(csv, text.encode(), "--csv")
        typer.echo(f"results: {' and '.join(str(file) for file in (store, csv) if file)}", err=True)
        runs = frame.read(study, text)
        shown = [tables.to_rich(table) for table in tables.make_tables(study, runs)]
        console(WIDTH).print(*shown, sep="\n")
        if figures is not None:
            done = [job for job in jobs if job.key in results]
            from mecazen_experiments.figures import draw  # noqa: PLC0415  # slow to import

            for file in draw(study, runs, done, active, figures):
                typer.echo(file)
    if failure is not None:
        raise failure


def choose_workers(jobs: int | None, cluster: str | None) -> AbstractContextManager[Workers]:
    """Return the workers of `--jobs` and `--cluster`."""
    if cluster is None:
        return nullcontext(local_workers(jobs))
    if jobs is not None:
        raise ConfigError("--jobs: the workers of --cluster have their own number of processes")
    return cluster_workers(cluster)


def _parse_seeds(text: str | None) -> list[int]:
    """Return the seeds of `--seeds`: `7`, `1-30`, or `1,4,9`; none without the option."""
    seeds: list[int] = []
    for part in text.split(",") if text is not None else ():
        match = re.fullmatch(r"\s*(\d{1,9})\s*(?:-\s*(\d{1,9})\s*)?", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if not 0 <= last - first < 1_000_000:
            raise ConfigError(f"--seeds {text}: must be a range or a list, such as 1-30 or 1,4,9")
        seeds += range(first, last + 1)
    return list(dict.fromkeys(seeds))


def _parse_sweep(option: str) -> tuple[str, tuple[str, ...]]:
    """Return the key and the values of `--sweep KEY=V1,V2`."""
    key, _, text = (part.strip() for part in option.partition("="))
    values = tuple(value.strip() for value in text.split(","))
    if not (key and all(values)):
        raise ConfigError(f"--sweep {option}: must be key.path=value,value")
    return key, values


def _prepare(study: Study, csv: Path | None, figures: Path | None) -> None:
    """Make the folder of figures, and refuse what can't be written, before the runs."""
    if csv is not None and not csv.absolute().parent.is_dir():
        raise ConfigError(f"--csv {csv}: no such folder")
    if figures is not None:
        if not study.figures:
            raise ConfigError("--figures: the study has no [[figure]]")
        files.make_folder(figures, "--figures")


@contextmanager
def _session(
    workers: AbstractContextManager[Workers], file: Path
) -> Iterator[tuple[Store, Workers, Progress]]:
    """Open the store and the workers, and show progress; Ctrl-C ends it in one line."""
    terminal = Console(stderr=True)
    bar = Bar(
        *(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()),
        TimeRemainingColumn(),
        console=terminal,
        transient=True,
        disable=not terminal.is_terminal,  # it would leave an empty line
        speed_estimate_period=600.0,  # a run takes seconds
    )
    task = bar.add_task("runs", total=None)

    def progress(done: int, total: int) -> None:
        bar.update(task, completed=done, total=total)

    try:
        with closing(Store(file)) as store, workers as active, bar:
            yield store, active, progress
    except KeyboardInterrupt:
        done, total = bar.tasks[0].completed, bar.tasks[0].total or 0
        typer.echo(
            f"interrupted after {done:g} of {total:g} runs; finished ones are kept in "
            f"{file}, and the same command continues from there",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None
