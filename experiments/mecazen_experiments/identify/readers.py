"""Reads runs from files: OptiOdom's folders, and CSV files with named columns."""

from __future__ import annotations

import csv
import gzip
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from mecazen.errors import ConfigError
from mecazen.files import read_bytes
from mecazen.robot import WHEELS
from mecazen.text import printable

from mecazen_experiments.identify.runs import MAX_PERIOD_S, Array, Run, checked

Format = Literal["mcap", "optiodom", "csv"]

COLUMNS = ("time_s", "x_m", "y_m", "yaw_rad", *(f"{wheel}_rad" for wheel in WHEELS))
"""Columns of a CSV file: time, the reference's pose, and the angles of the wheels."""
UNITS = {"s": 1.0, "ms": 1e3, "µs": 1e6, "ns": 1e9}
"""Units of time per second."""
OPTIODOM_FORWARD = np.array([1.0, -1.0, 1.0, -1.0])
"""Signs of OptiOdom's wheels while the robot drives forward."""


def optiodom(folder: Path) -> list[Run]:
    """Return the runs of a folder of sessions in the format of OptiOdom's data.

    A session is a folder with `metadata.csv` and `run-NN.csv`, plain or as gzip. A run has the
    columns time [s], x [m], y [m], yaw [rad], and the displacement of the wheels 1 to 4
    [revolutions per sample]. The published reference is stretched to the odometry's duration. So
    rotation that the odometry did not log is corrected by the ratio of both durations in
    `metadata.csv` (`gt_ti`, `gt_tf`, `odo_ti`, `odo_tf`), if they are given.

    Raises:
        ConfigError: One line with the file and the reason.
    """
    sessions = [
        one for one in (folder, *sorted(folder.glob("*/"))) if (one / "metadata.csv").is_file()
    ]
    if not sessions:
        raise ConfigError(f"{folder}: no session: a folder with metadata.csv and run-01.csv[.gz]")
    return [run for session in sessions for run in _session(session)]


def _session(folder: Path) -> list[Run]:
    text = _text(folder / "metadata.csv")
    metadata = {row[0]: row[1:] for row in csv.reader(io.StringIO(text)) if row}
    markers = " ".join(filter(None, metadata.get("imarkers", ())))
    kind = folder.name.split("_", maxsplit=1)[0]
    runs = []
    for path in sorted((*folder.glob("run-*.csv"), *folder.glob("run-*.csv.gz"))):
        table = _numbers(_text(path), path, 8)
        number = path.name.removeprefix("run-").split(".")[0]
        stretch = _stretch(metadata, int(number) - 1, folder) if number.isdecimal() else 1.0
        turned = np.cumsum(table[:, 4:] * OPTIODOM_FORWARD, axis=0)
        run = Run(
            name=f"{folder.name}/{path.name}",
            session=folder.name,
            times=table[:, 0],
            poses=table[:, 1:4],
            wheels=2.0 * math.pi * stretch * turned,
            group=f"{kind}, markers {markers}" if markers else kind,
            missing=1.0 - 1.0 / stretch,
        )
        runs.append(checked(run))
    if not runs:
        raise ConfigError(f"{folder}: no run-*.csv or run-*.csv.gz")
    return runs


def _stretch(metadata: Mapping[str, Sequence[str]], index: int, folder: Path) -> float:
    """Return the duration of the reference over that of the odometry; 1 if they are not given."""
    try:
        begin, end, first, last = (
            float(metadata[name][index]) for name in ("gt_ti", "gt_tf", "odo_ti", "odo_tf")
        )
        ratio = (end - begin) / (last - first)
    except (KeyError, IndexError):
        return 1.0
    except (ValueError, ZeroDivisionError):
        ratio = math.nan
    if not 0.5 < ratio < 2.0:
        raise ConfigError(
            f"{folder / 'metadata.csv'}: durations of run {index + 1}: the reference's over the "
            f"odometry's is {ratio:.3g}; it must be within 0.5 to 2"
        )
    return ratio


def csv_files(paths: Sequence[Path], names: Mapping[str, str]) -> list[Run]:
    """Return a run for each CSV file with a header.

    Args:
        paths: The files.
        names: Names of columns that differ from `COLUMNS`, by the names in `COLUMNS`.

    Raises:
        ConfigError: One line with the file and the reason.
    """
    if unknown := [name for name in names if name not in COLUMNS]:
        raise ConfigError(f"--columns: {unknown[0]}: unknown; allowed: {', '.join(COLUMNS)}")
    runs = []
    for path in paths:
        header, _, rest = _text(path).partition("\n")
        given = [name.strip() for name in header.split(",")]
        wanted = [names.get(name, name) for name in COLUMNS]
        if lacking := [name for name in wanted if name not in given]:
            raise ConfigError(
                printable(
                    f"{path}: no column {lacking[0]!r}; its columns are {', '.join(given)}; "
                    "--columns maps names"
                )
            )
        table = _numbers(rest, path, len(given), first_line=2)
        table = table[:, [given.index(name) for name in wanted]]
        times, unit = _seconds(table[:, 0])
        run = Run(path.name, path.stem, times, table[:, 1:4], table[:, 4:], time_unit=unit)
        runs.append(checked(run))
    return runs


def _seconds(times: Array) -> tuple[Array, str]:
    """Return times from the first one on [s], and their unit in the file.

    The interval shows the unit: robots log every 0.25 ms to 250 ms.
    """
    if len(times) < 2 or not np.isfinite(times).all():
        return times, "s"  # refused later
    interval = float(np.median(np.diff(times)))
    unit = next((unit for unit in UNITS if interval <= MAX_PERIOD_S * UNITS[unit]), "s")
    return (times - times[0]) / UNITS[unit], unit


def _text(path: Path) -> str:
    if path.suffix in (".db3", ".bag"):
        raise ConfigError(
            printable(
                f"{path}: a bag of ROS can't be read; export its joint states and reference to CSV "
                f"with the columns {', '.join(COLUMNS)}"
            )
        )
    content = read_bytes(path)
    try:
        if path.suffix == ".gz":
            content = gzip.decompress(content)
        return content.decode()
    except (OSError, EOFError, UnicodeDecodeError) as error:
        raise ConfigError(
            printable(f"{path}: can't be read as CSV, plain or as gzip: {error}")
        ) from None


def _numbers(text: str, path: Path, columns: int, first_line: int = 1) -> Array:
    """Return a table of numbers with the given number of columns."""
    try:
        table = (
            np.loadtxt(io.StringIO(text), delimiter=",", ndmin=2)
            if text.strip()
            else np.empty((0, columns))
        )
    except ValueError:
        raise ConfigError(_first_error(text, path, columns, first_line)) from None
    if table.shape[1] != columns:
        raise ConfigError(f"{path}: has {table.shape[1]} columns; {columns} are needed")
    return np.asarray(table)


def _first_error(text: str, path: Path, columns: int, first_line: int) -> str:
    """Return a line on the first cell or row that can't be read."""
    for number, line in enumerate(text.splitlines(), first_line):
        cells = line.split(",")
        if len(cells) != columns:
            return f"{path}: line {number} has {len(cells)} columns; {columns} are needed"
        for cell in cells:
            try:
                float(cell)
            except ValueError:
                return printable(f"{path}: line {number}: {cell!r} is not a number")
    return f"{path}: is not a table of numbers"
