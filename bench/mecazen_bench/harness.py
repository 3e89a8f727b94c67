"""Figures with their spread and goal, the rounds that measure them, their file and their tables."""

from __future__ import annotations

import csv
import io
import os
import platform
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec
import numpy as np
from mecazen.errors import MecazenError
from mecazen_tools import files

LIBRARIES = ("dartpy", "mujoco", "eclipse-zenoh", "msgspec", "numpy")
LEAST = 0.001
"""Relative change that is ignored: computed figures have no spread, unlike timed ones, but differ
in their last digits between processors and library versions."""

Row = dict[str, tuple[float, str]]
"""Values and goals by column."""
Tables = dict[str, dict[str, Row]]
"""Rows by table and name, as a benchmark measures them in a round."""


class ResultsError(MecazenError):
    """A results file that can't be used; exit code 1 means that a figure became worse."""

    exit_code = 2


class Figure(msgspec.Struct, frozen=True):
    """A measured value; for several rounds, the median with the quartiles."""

    table: str
    row: str
    column: str
    value: float
    low: float
    high: float
    goal: str
    """`less` or `more`, or the correct value as a number."""

    def worse_by(self, before: float) -> float:
        """Return by how much the value is worse than an earlier value; negative if better."""
        if self.goal in ("less", "more"):
            return self.value - before if self.goal == "less" else before - self.value
        return abs(self.value - float(self.goal)) - abs(before - float(self.goal))

    def __str__(self) -> str:
        value, low, high = map(_number, (self.value, self.low, self.high))
        return value if low == high else f"{value} ({low} to {high})"


def measure(
    benchmarks: Mapping[str, Callable[[], Tables]], rounds: int, report: Callable[[str], object]
) -> list[Figure]:
    """Measure benchmarks in interleaved rounds: the load of other processes affects all equally.

    Ratios are computed within a round, so they compare neighbouring runs. `report` is called with
    the name of the next measurement.
    """
    values: dict[tuple[str, str, str], list[float]] = {}
    goals: dict[tuple[str, str, str], str] = {}
    for number in range(rounds):
        for name, benchmark in benchmarks.items():
            report(f"{name}, round {number + 1} of {rounds}")
            for table, rows in benchmark().items():
                for row, columns in rows.items():
                    for column, (value, goal) in columns.items():
                        values.setdefault((table, row, column), []).append(value)
                        goals[table, row, column] = goal
    figures = []
    for key, measured in values.items():
        low, middle, high = np.percentile(measured, (25, 50, 75)).tolist()
        figures.append(Figure(*key, middle, low, high, goals[key]))
    return figures


def tables(figures: Iterable[Figure]) -> dict[str, str]:
    """Return tables in Markdown by title, with a column for each title of a figure."""
    by_table: dict[str, dict[str, dict[str, Figure]]] = {}
    for figure in figures:
        rows = by_table.setdefault(figure.table, {})
        rows.setdefault(figure.row, {})[figure.column] = figure
    result = {}
    for title, rows in by_table.items():
        columns = list(dict.fromkeys(column for row in rows.values() for column in row))
        body = [
            (name, *(str(row.get(column, "")) for column in columns)) for name, row in rows.items()
        ]
        result[title] = _markdown(("", *columns), body)
    return result


def compare(before: Sequence[Figure], after: Sequence[Figure]) -> tuple[str, int]:
    """Return a table of the figures in both results, and the number of those that became worse."""
    earlier = {(figure.table, figure.row, figure.column): figure for figure in before}
    rows, worse = [], 0
    for figure in after:
        old = earlier.get((figure.table, figure.row, figure.column))
        if old is None:
            continue
        worse_by = figure.worse_by(old.value)
        spread = old.high - old.low + figure.high - figure.low
        noise = max(spread, LEAST * abs(old.value))
        verdict = "" if abs(worse_by) <= noise else "worse" if worse_by > 0.0 else "better"
        worse += verdict == "worse"
        ratio = f"{figure.value / old.value:.3f}" if old.value else ""
        name = figure.table, figure.row, figure.column
        rows.append((*name, str(old), str(figure), ratio, verdict))
    if not rows:
        raise ResultsError("no figure is in both results")
    return _markdown(("", "", "", "before", "after", "ratio", ""), rows), worse


def write(figures: Sequence[Figure], path: Path) -> None:
    """Write the figures as CSV; create the folder."""
    files.make_folder(path.parent, "--csv")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(Figure.__struct_fields__)
    writer.writerows(msgspec.structs.astuple(figure) for figure in figures)
    files.write(path, text.getvalue().encode(), "--csv")


def read(path: Path) -> list[Figure]:
    """Return the figures that `write` has written."""
    try:
        rows = list(csv.DictReader(io.StringIO(path.read_text())))
        return [msgspec.convert(row, Figure, strict=False) for row in rows]
    except OSError as error:
        raise ResultsError(f"{path}: {error.strerror}") from None
    except (ValueError, csv.Error) as error:
        raise ResultsError(f"{path}: no results of mecazen bench: {error}") from None


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"|{''.join(f' {cell} |' if cell else ' |' for cell in li)}\n" for li in lines)


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1e4 else f"{value:.4g}"


def machine() -> str:
    """Return processor, system and libraries."""
    libraries = []
    for name in LIBRARIES:
        with suppress(PackageNotFoundError):
            libraries.append(f"{name} {version(name)}")
    model = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    processor = model[1].strip() if model else platform.machine()
    kernel = ".".join(platform.release().split(".")[:2])
    system = f"Linux {kernel}, Python {platform.python_version()}"
    cores = len(os.sched_getaffinity(0))
    return f"{processor}, {cores} cores; {system}, {', '.join(libraries)}"
