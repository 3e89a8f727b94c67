"""The command `mecazen identify`; `mecazen_experiments.identify.cli` declares its options."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import msgspec
import typer
from mecazen.config import ControllerConfig
from mecazen.errors import ConfigError
from mecazen.loading import given_file, load_table
from mecazen.robot import Robot
from mecazen_tools import files

from mecazen_experiments.config import experiment_path
from mecazen_experiments.identify import readers, report
from mecazen_experiments.identify import validate as validation
from mecazen_experiments.identify.identification import (
    best_geometry,
    residuals,
)
from mecazen_experiments.identify.identification import identify as identified
from mecazen_experiments.identify.motors import MotorLog, identified_motors
from mecazen_experiments.identify.plan import csv, plan
from mecazen_experiments.identify.recordings import recorded
from mecazen_experiments.identify.runs import Run
from mecazen_experiments.identify.simulated import identified_robot


def identify(
    sources: Sequence[Path], format_: str | None, robot: str, columns: Sequence[str], out: Path
) -> None:
    """Identify a robot; print the main results, and write the report."""
    base = load_table(given_file(robot, "robot"), Robot)
    runs, logs = read(sources, format_, columns)
    files.make_folder(out, "--out")
    found = identified(base, runs, logs)
    best = best_geometry(found)
    changed = identified_robot(base, best.parameters, found.roller_count, runs[0])
    if found.motors:
        changed = msgspec.structs.replace(changed, motors=identified_motors(found.motors))
    from mecazen_experiments.identify.figures import draw  # noqa: PLC0415  # slow to import

    figures = draw(found, residuals(base, runs, found), out)
    for note in found.notes:
        typer.echo(note, err=True)
    typer.echo(f"lateral over forward gain: {report.interval(found.lateral_gain, 4)}")
    typer.echo(f"most likely number of rollers: {found.roller_count}")
    for file in (*report.write(found, changed, figures, out), *figures):
        typer.echo(file)


def write_plan(file: Path) -> None:
    """Write the excitation, the commands that make all parameters observable."""
    files.write(file, csv(plan(ControllerConfig())).encode(), "--plan")


def validate(file: str, folder: Path, out: Path) -> None:
    """Validate models; print the tables, and write them with figures and the identified robot."""
    config, robot = validation.load(experiment_path(file))
    runs, _ = read([folder], "optiodom")
    files.make_folder(out, "--out")
    found, changed = validation.validate(config, robot, runs)
    from mecazen_experiments.identify import figures  # noqa: PLC0415  # slow to import

    drawn = {
        "lateral_gain": figures.lateral_gain(found.sessions),
        "drift": figures.drift_by_model(found),
    }
    for line in report.validation_lines(found):
        typer.echo(line)
    pictures = figures.write(drawn, out)
    for path in (*report.write_validation(found, changed, pictures, out), *pictures):
        typer.echo(path)


def read(
    sources: Sequence[Path], format_: str | None = None, columns: Sequence[str] = ()
) -> tuple[list[Run], list[MotorLog]]:
    """Return the runs of files or folders, and the logs of their motors.

    Raises:
        ConfigError: One line with the file or option and the reason.
    """
    if format_ is None:
        is_mcap = all(path.suffix == ".mcap" for path in sources)
        format_ = "mcap" if is_mcap else "csv"
    if format_ not in get_args(readers.Format):
        known = ", ".join(get_args(readers.Format))
        raise ConfigError(f"--format {format_}: unknown; allowed: {known}")
    if format_ == "optiodom":
        return [run for folder in sources for run in readers.optiodom(folder)], []
    if format_ == "mcap":
        found = [recorded(path) for path in sources]
        return [run for runs, _ in found for run in runs], [
            log for _, logs in found for log in logs
        ]
    names = dict(column.split("=", 1) for column in columns if "=" in column)
    if len(names) != len(columns):
        raise ConfigError("--columns must be NAME=COLUMN, e.g. time_s=t")
    return readers.csv_files(sources, names), []
