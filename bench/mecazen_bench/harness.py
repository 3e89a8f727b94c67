"""Figures with their spread and goal, the rounds that measure them, their file and their tables."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from mecazen.errors import MecazenError
from mecazen_tools import files

Goal = Literal["less", "more"] | float | tuple[float | None, float | None]
"""Direction of improvement, the correct value, or the target: a range with at least one end."""

SCHEMA = 3
"""Schema version, increased when the meaning of older files changes."""
LIBRARIES = ("dartpy", "mujoco", "eclipse-zenoh", "msgspec", "numpy")
LEAST = 0.001
"""Relative change that is ignored: computed figures have no spread, unlike timed ones, but differ
in their last digits between processors and library versions."""


class ResultsError(MecazenError):
    """A results file that can't be used; exit code 1 means that a figure became worse."""

    exit_code = 2


class Figure(msgspec.Struct, frozen=True, omit_defaults=True):
    """A measured value; for several rounds, the median with the quartiles."""

    value: float
    goal: Goal
    quartiles: tuple[float, float] | None = None

    @property
    def met(self) -> bool | None:
        """Whether value and quartiles are in the target's range; None without a target."""
        if not isinstance(self.goal, tuple):
            return None
        low, high = self.goal
        least, most = self.quartiles or (self.value, self.value)
        return (low is None or low <= least) and (high is None or most <= high)

    @property
    def spread(self) -> float:
        """Distance between the quartiles."""
        low, high = self.quartiles or (self.value, self.value)
        return high - low

    def worse_by(self, before: float) -> float:
        """Return by how much the value is worse than an earlier value; negative if better."""
        match self.goal:
            case "less" | (None, _):
                return self.value - before
            case "more" | (_, None):
                return before - self.value
            case (float(low), float(high)):
                correct = (low + high) / 2.0
            case correct:
                assert isinstance(correct, float)
        return abs(self.value - correct) - abs(before - correct)

    def __str__(self) -> str:
        low, high = map(_number, self.quartiles or (self.value, self.value))
        words = [_number(self.value)]
        if low != high:
            words.append(f"({low} to {high})")
        if isinstance(self.goal, tuple):
            words.append(f"{'✓' if self.met else '✗'} {_range(*self.goal)}")
        return " ".join(words)


Rows = Mapping[str, Mapping[str, Figure]]
"""Figures by subject and title."""


class MarkdownTable(msgspec.Struct, frozen=True):
    """A table of a result, with its title and its caption."""

    title: str
    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @property
    def sentences(self) -> str:
        """The caption as sentences, one for each of its parts."""
        parts = [part.strip() for part in self.caption.split(";")]
        # µs/tick keeps its small letter
        return " ".join(f"{'µ' if p[:1] == 'µ' else p[:1].upper()}{p[1:]}." for p in parts)

    def __str__(self) -> str:
        title = f"**{self.title}.** " if self.title else ""
        return f"{title}{self.sentences}\n\n{markdown(self.head, self.rows)}"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return the lines of a table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"|{''.join(f' {cell} |' if cell else ' |' for cell in li)}\n" for li in lines)


class Group(msgspec.Struct, frozen=True):
    """A table of figures, and how they were measured."""

    title: str
    how: str
    rows: Rows

    def table(self) -> MarkdownTable:
        """Return the group as a table with a column for each title of a figure."""
        titles = list(dict.fromkeys(title for row in self.rows.values() for title in row))
        body = [
            (subject, *(str(row.get(title, "")) for title in titles))
            for subject, row in self.rows.items()
        ]
        return MarkdownTable(self.title, self.how, ("", *titles), tuple(body))


class Results(msgspec.Struct, frozen=True):
    """All figures of a run."""

    schema: int
    context: str
    """Machine, versions and load, in two lines."""
    benchmarks: dict[str, tuple[Group, ...]]

    def named(self) -> Iterator[tuple[tuple[str, str, str], Figure]]:
        """Yield each figure with its group, subject and title."""
        for groups in self.benchmarks.values():
            for group in groups:
                for subject, row in group.rows.items():
                    yield from (((group.title, subject, title), row[title]) for title in row)


def measure(
    benchmarks: Mapping[str, Callable[[], list[Group]]],
    rounds: int,
    report: Callable[[str], object],
) -> Results:
    """Measure benchmarks in interleaved rounds: the load of other processes affects all equally.

    Ratios are computed within a round, so they compare neighbouring runs. `report` is called with
    the name of the next measurement.
    """
    before = _load()
    found: dict[str, list[list[Group]]] = {name: [] for name in benchmarks}
    for number in range(rounds):
        for name, benchmark in benchmarks.items():
            report(f"{name}, round {number + 1} of {rounds}")
            found[name].append(benchmark())
    context = f"{machine()};\nload {before} before, {_load()} after."
    return Results(SCHEMA, context, {name: tuple(merged(each)) for name, each in found.items()})


def merged(rounds: Sequence[Sequence[Group]]) -> Iterator[Group]:
    """Yield the groups with the medians and quartiles of all rounds."""
    for same in zip(*rounds, strict=True):
        first = same[0]
        if len(same) == 1:
            yield first
            continue
        rows = {
            subject: {
                title: _median([group.rows[subject][title].value for group in same], figure.goal)
                for title, figure in row.items()
            }
            for subject, row in first.rows.items()
        }
        yield Group(first.title, f"{first.how}; medians (quartiles) of {len(same)} rounds", rows)


def _median(values: Sequence[float], goal: Goal) -> Figure:
    low, middle, high = np.percentile(values, (25, 50, 75)).tolist()
    return Figure(middle, goal, (low, high))


def compare(before: Results, after: Results) -> tuple[str, int]:
    """Return a table of the figures in both results, and the number of those that became worse."""
    earlier = dict(before.named())
    rows, worse = [], 0
    for name, figure in after.named():
        old = earlier.get(name)
        if old is None:
            continue
        worse_by = figure.worse_by(old.value)
        noise = max(old.spread + figure.spread, LEAST * abs(old.value))
        verdict = "" if abs(worse_by) <= noise else "worse" if worse_by > 0.0 else "better"
        worse += verdict == "worse"
        ratio = f"{figure.value / old.value:.3f}" if old.value else ""
        rows.append([*name, str(old), str(figure), ratio, verdict])
    if not rows:
        raise ResultsError("no figure is in both results")
    return markdown(["", "", "", "before", "after", "ratio", ""], rows), worse


def write(results: Results, path: Path) -> None:
    """Write the figures and the tables that show them; create the folder."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultsError(f"{path.parent}: {error.strerror}") from None
    groups = [group for each in results.benchmarks.values() for group in each]
    content = msgspec.to_builtins(results) | {"tables": [group.table() for group in groups]}
    files.write(path, msgspec.json.format(msgspec.json.encode(content)) + b"\n")


def read(path: Path) -> Results:
    """Return the results that `write` has written."""
    try:
        found = msgspec.json.decode(path.read_bytes(), type=Results)
    except OSError as error:
        raise ResultsError(f"{path}: {error.strerror}") from error
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise ResultsError(f"{path}: no results of mecazen bench: {error}") from error
    if found.schema != SCHEMA:
        raise ResultsError(f"{path}: schema {found.schema} instead of {SCHEMA}: measure again")
    return found


def _number(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1e4 else f"{value:.4g}"


def _range(low: float | None, high: float | None) -> str:
    if low is None or high is None:
        return f"< {high:g}" if low is None else f"≥ {low:g}"
    return f"{(low + high) / 2:g} ± {(high - low) / 2:g}"


def _cpu() -> str:
    model = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return model[1].strip() if model else platform.machine()


def _cores() -> int:
    return len(os.sched_getaffinity(0))


def machine() -> str:
    """Return processor, system and libraries."""
    libraries = []
    for name in LIBRARIES:
        with suppress(PackageNotFoundError):
            libraries.append(f"{name} {version(name)}")
    kernel = ".".join(platform.release().split(".")[:2])
    system = f"Linux {kernel}, Python {platform.python_version()}"
    return f"{_cpu()}, {_cores()} cores; {system}, {', '.join(libraries)}"


def _load() -> str:
    return " ".join(f"{value:.2f}" for value in os.getloadavg())
