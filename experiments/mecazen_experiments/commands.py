"""`mecazen experiment run`: runs a study, and shows its tables, figures and films."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import typer
from mecazen.errors import ConfigError
from mecazen.files import to_value
from mecazen.loading import load_scenario, parse_settings
from mecazen_tools import files
from mecazen_tools.cli.options import console
from mecazen_tools.observe import observe
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
    do_all,
    local_workers,
    run_all,
)
from mecazen_experiments.study import Study, chosen, load_study, parse_sweeps, study_path

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in a shell: 128 and the signal's number."""
WIDTH = 160
"""Width of the tables [characters] if the output is not a terminal."""


class RunOptions(NamedTuple):
    """Where runs are done and kept, and what is written."""

    jobs: int | None
    """Processes on this machine; None for one on each core."""
    cluster: str | None
    """Address of a Dask scheduler to send the runs to."""
    store: Path
    csv: Path | None
    """File for the frame: one row a run."""
    figures: Path | None
    """Folder for the study's figures."""
    films: Path | None
    """Folder for a recording of the first run of each row."""


def expanded(
    name: str,
    seeds: str | None,
    walks: Path | None,
    set: Sequence[str],  # noqa: A002  # the option's name
    sweep: Sequence[str],
    only: Sequence[str],
) -> tuple[Study, list[Job]]:
    """Return a study and its runs; the arguments are those of the command."""
    study = chosen(load_study(study_path(name)), only)
    walk_files = recordings(walks)
    return study, expand(study, parse_seeds(seeds), tuple(set), parse_sweeps(sweep), walk_files)


def run(options: RunOptions, name: str, **choice: Any) -> None:
    """Run a study; print its tables, and write its frame, figures and films on demand.

    `choice` are further arguments of `expanded`.
    """
    _refuse_unwritable(load_study(study_path(name)), name, options)
    study, jobs = expanded(name, **choice)

    def check(job: Job, columns: Columns) -> None:
        tables.check(study, frame.read(study, frame.to_csv([job], {job.key: columns})))

    failure: RunsFailedError | None = None
    with _session(options) as (store, workers, progress):
        try:
            results = run_all(jobs, store, workers, progress, check)
        except RunsFailedError as error:
            failure, results = error, store.find(job.key for job in jobs)
            if not results:
                raise
        text = frame.to_csv(jobs, results)
        if options.csv is not None:
            files.write(options.csv, text.encode(), "--csv")
        places = " and ".join(str(file) for file in (options.store, options.csv) if file)
        typer.echo(f"results: {places}", err=True)
        runs = frame.read(study, text)
        shown = [tables.to_rich(table) for table in tables.make_tables(study, runs)]
        console(WIDTH).print(*shown, sep="\n")
        done = [job for job in jobs if job.key in results]
        for file in _drawn(study, runs, done, workers, options):
            typer.echo(file)
    if failure is not None:
        raise failure


def parse_seeds(text: str | None) -> Sequence[int]:
    """Return the seeds of `--seeds`: `7`, `1-30`, or `1,4,9`; none without the option.

    Raises:
        ConfigError: The text is no such list, or the seeds are too many.
    """
    seeds: list[int] = []
    for part in text.split(",") if text is not None else ():
        match = re.fullmatch(r"\s*(\d{1,9})\s*(?:-\s*(\d{1,9})\s*)?", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if not 0 <= last - first < 1_000_000:
            raise ConfigError(f"--seeds {text}: must be a range or a list, such as 1-30 or 1,4,9")
        seeds += range(first, last + 1)
    return list(dict.fromkeys(seeds))


def recordings(folder: Path | None) -> list[Path]:
    """Return the walks of `--walks`."""
    walks = sorted(folder.glob("*.csv")) if folder else []
    if folder and not walks:
        raise ConfigError(f"--walks {folder}: no such folder, or no *.csv in it")
    return walks


def film(folder: Path, job: Job) -> Path:
    """Simulate a job, and record the whole run into a folder; return the file."""
    assert job.scenario is not None
    name = re.sub(r"[^\w.=+-]+", "_", job.row.replace(", ", "-"))
    file = folder / f"{name}.mcap"
    recorded = (
        f"services={to_value([*job.load().services, 'recorder'])}",
        f"recorder.file={to_value(str(file))}",
    )
    observe(load_scenario(job.scenario, parse_settings((*job.settings, *recorded))))
    return file


def _drawn(
    study: Study, runs: Any, jobs: Sequence[Job], workers: Workers, options: RunOptions
) -> Iterator[Path]:
    """Draw figures and record films; yield the files."""
    first = {job.row: job for job in reversed(jobs)}
    if options.films is not None:
        work = partial(film, options.films.resolve())
        yield from (file for _, file in do_all(work, [*first.values()], workers))
    if options.figures is not None:
        from mecazen_experiments import figures  # noqa: PLC0415  # slow to import

        yield from figures.draw(study, runs, jobs, workers, options.figures)


def _refuse_unwritable(study: Study, name: str, options: RunOptions) -> None:
    """Make the folders of the options, and refuse what can't be written, before the runs."""
    if options.csv is not None and not options.csv.absolute().parent.is_dir():
        raise ConfigError(f"--csv {options.csv}: no such folder")
    if options.figures is not None:
        from mecazen_experiments import figures  # noqa: PLC0415  # slow to import

        if not study.figures:
            raise ConfigError(f"--figures: {name} has no [[figure]]")
        figures.check(study)
    if options.films is not None and not all(case.scenario for case in study.cases):
        raise ConfigError(f"--films: {name} has a case without a scenario")
    for option, folder in (("--figures", options.figures), ("--films", options.films)):
        if folder is not None:
            files.make_folder(folder, option)


@contextmanager
def _session(options: RunOptions) -> Iterator[tuple[Store, Workers, Progress]]:
    """Open the store and the workers, and show progress; Ctrl-C ends it in one line."""
    if options.cluster is not None and options.jobs is not None:
        raise ConfigError("--jobs: the workers of --cluster have their own number of processes")
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
        with closing(Store(options.store)) as store, _workers(options) as workers, bar:
            yield store, workers, progress
    except KeyboardInterrupt:
        done, total = bar.tasks[0].completed, bar.tasks[0].total or 0
        typer.echo(
            f"interrupted after {done:g} of {total:g} runs; finished ones are kept in "
            f"{options.store}, and the same command continues from there",
            err=True,
        )
        raise typer.Exit(INTERRUPTED) from None


def _workers(options: RunOptions) -> AbstractContextManager[Workers]:
    if options.cluster is not None:
        return cluster_workers(options.cluster)
    return nullcontext(local_workers(options.jobs))
