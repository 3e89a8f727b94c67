"""The command `mecazen identify`; `mecazen_experiments.identify.cli` declares its options."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import typer
from mecazen.errors import ConfigError, MecazenError
from mecazen.loading import given_file, load_table
from mecazen.robot import Robot

from mecazen_experiments.identify import readers, report
from mecazen_experiments.identify.identification import (
    best_geometry,
    identified_robot,
    residuals,
)
from mecazen_experiments.identify.identification import identify as identified
from mecazen_experiments.identify.runs import Run


def identify(
    sources: Sequence[Path], format_: str, robot: str, columns: Sequence[str], out: Path
) -> None:
    """Identify; print the main results, and write the report."""
    base = load_table(given_file(robot, "robot"), Robot)
    runs = read(sources, format_, columns)
    make_folder(out)
    found = identified(base, runs)
    changed = identified_robot(base, best_geometry(found), found.roller_count)
    from mecazen_experiments.identify.figures import draw  # noqa: PLC0415  # slow to import

    figures = draw(found, residuals(base, runs, found), out)
    for note in found.notes:
        typer.echo(note, err=True)
    gain = found.lateral_gain
    typer.echo(f"lateral over forward gain: {gain.mean:.4f} ({gain.low:.4f} to {gain.high:.4f})")
    typer.echo(f"most likely number of rollers: {found.roller_count}")
    for file in (*report.write(found, changed, figures, out), *figures):
        typer.echo(file)


def read(sources: Sequence[Path], format_: str, columns: Sequence[str] = ()) -> list[Run]:
    """Return the runs of files or folders.

    Raises:
        ConfigError: One line with the file or option and the reason.
    """
    if format_ not in get_args(readers.Format):
        known = ", ".join(get_args(readers.Format))
        raise ConfigError(f"--format {format_}: unknown; allowed: {known}")
    if format_ == "optiodom":
        return [run for folder in sources for run in readers.optiodom(folder)]
    names = dict(column.split("=", 1) for column in columns if "=" in column)
    if len(names) != len(columns):
        raise ConfigError("--columns must be NAME=COLUMN, e.g. time_s=t")
    return readers.csv_files(sources, names)


def make_folder(folder: Path) -> None:
    """Make the folder of the results.

    Raises:
        MecazenError: It can't be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MecazenError(f"--out {folder}: {error.strerror}") from None
