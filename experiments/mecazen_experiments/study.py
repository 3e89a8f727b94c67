"""A study: scenarios, settings, grid, seeds, tables and figures, in one TOML file.

Its program is a function of a job that returns the columns of its row: numbers, texts, true or
false, or None where there is nothing to measure. Each run returns the same columns.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from mecazen.errors import ConfigError
from mecazen.explain import suggestion
from mecazen.files import read_toml
from mecazen.loading import given_file, load_table, named_file
from mecazen.schema import Finite, Positive, Section

Seed = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
Runs = Annotated[int, msgspec.Meta(ge=1, le=1_000_000)]
Name = Annotated[str, msgspec.Meta(min_length=1)]
Settings = tuple[str, ...]
"""Overrides `key=value`, as in `--set`."""
Label = bool | int | float | str
Over = Literal["sum", "min", "median", "p90", "max"]
How = Literal["mean", "share", "value", "difference", "ratio", "most_per_hour"] | Over
"""The way in which a column of a table summarises the runs of a row."""
Value = bool | int | float | str | None
"""A value of a column that a program returns."""
UNIT = ("case", "draw")
"""The default unit; `draw` is the walk, or the seed without a walk."""
PACKAGE = Path(__file__).parent
PROGRAMS = {
    "followbench": f"{PACKAGE.name}.followbench.program",
    "following": f"{PACKAGE.name}.scores",
    "fuzz": f"{PACKAGE.name}.fuzz",
    "mocap": f"{PACKAGE.name}.mocap",
    "safety": f"{PACKAGE.name}.safety",
    "surrogate": "mecazen_gym.surrogate",
    "walkers": f"{PACKAGE.name}.limit",
}
"""Modules of the programs, by the names of their functions, which are those in studies."""


class Case(Section):
    """A scenario with settings, and the reference values of its scores."""

    name: Name
    scenario: Path | None = None
    """The scenario's name, or its file, relative to the study's file; the study's by default.

    Some programs need none.
    """
    settings: Settings = msgspec.field(name="set", default=())
    labels: dict[Name, str] = msgspec.field(default_factory=dict)
    """Further columns of the frame, such as a view; empty where a case has none."""
    values: dict[Name, str] = msgspec.field(default_factory=dict)
    """Texts that settings may use as `$NAME`."""
    vary: dict[Name, tuple[Finite, Finite]] = msgspec.field(default_factory=dict)
    """Values that each seed draws between two limits; settings may use them as `$NAME`."""
    only: dict[Name, Annotated[tuple[str, ...], msgspec.Meta(min_length=1)]] = msgspec.field(
        default_factory=dict
    )
    """The choices of an axis of the grid that this case runs with; all of other axes."""
    published: dict[Name, Positive] = msgspec.field(default_factory=dict)
    """Published means of scores: the columns `published_SCORE`."""
    limits: dict[Name, Positive] = msgspec.field(default_factory=dict)
    """Upper limits of means of scores, or of their ratios as `SCORE_ratio`."""


class Column(Section, array_like=True):
    """A column of a table: [header, name, digits], or [header, name, digits, how]."""

    header: str
    name: str
    """A column of the frame."""
    digits: Annotated[int, msgspec.Meta(ge=0, le=9)]
    """Decimals."""
    how: How = "mean"


class StudyTable(Section):
    """A table: its rows, and the columns of scores."""

    columns: Annotated[tuple[Column, ...], msgspec.Meta(min_length=1)]
    title: str = ""
    where: str = ""
    """A query of the frame, such as `view == 'back'`; all runs if empty."""
    rows: tuple[str, ...] = ()
    """Columns of the frame; each combination of their values is a row. Without any, all runs are
    one row."""
    unit: tuple[str, ...] = UNIT
    """Columns whose values make an independent unit: the mean over the runs of a unit is taken
    first."""
    each: dict[Name, tuple[str, ...]] = msgspec.field(default_factory=dict)
    """Words that replace `{NAME}` in the names of columns: a row for each word."""
    reference: dict[Name, Label] = msgspec.field(default_factory=dict)
    """The row that `difference` and `ratio` compare with: it has these values, and the other
    values of the row."""
    note: str = ""
    """A sentence above the table."""

    def __post_init__(self) -> None:
        compared = {column.how for column in self.columns} & {"difference", "ratio"}
        if compared and not self.reference:
            raise ValueError(f"table {self.title!r}: {min(compared)!r} needs a reference")
        for name in self.reference.keys() - {*self.rows}:
            raise ValueError(
                f"table {self.title!r}: reference: {name} is not one of rows = {list(self.rows)}"
            )


class StudyFigure(Section):
    """A figure of the runs' scores, or of single runs."""

    name: Annotated[str, msgspec.Meta(pattern=r"^[\w-]+$")]
    """The name of the file."""
    kind: Literal["points", "paths", "errors"] = "points"
    x: str = ""
    """A column of the frame."""
    y: tuple[str, ...] = ()
    """Columns of the frame: a panel for each."""
    by: str = ""
    """A column of the frame: a colour for each value."""
    where: str = ""
    """A query of the frame, as in tables."""
    labels: tuple[str, ...] = ()
    """The labels of the axes of x and each y; the names of the columns by default."""


class Study(Section):
    """Cases, each run for each combination of grid and sweep, once for each seed."""

    cases: Annotated[tuple[Case, ...], msgspec.Meta(min_length=1)]
    extends: str = ""
    """File of another study, relative to this one, whose keys this one has unless it sets them."""
    program: Name = "following"
    """The program of a run, a name in `PROGRAMS`."""
    seeds: Runs = 30
    """Number of seeds."""
    first_seed: Seed = 1
    """First seed; the others are consecutive."""
    scenario: Path | None = None
    """The scenario of cases that name none."""
    settings: Settings = msgspec.field(name="set", default=())
    """Settings of all cases."""
    grid: dict[Name, Annotated[dict[Name, Settings], msgspec.Meta(min_length=1)]] = msgspec.field(
        default_factory=dict
    )
    """Axes of named choices, such as a view or a driver."""
    sweep: dict[Name, tuple[Label, ...]] = msgspec.field(default_factory=dict)
    """Settings with several values each."""
    files: str = ""
    """A pattern relative to the study's file, or else to this package; each matching file is the
    `file` of its own jobs."""
    derive: dict[Name, str] = msgspec.field(default_factory=dict)
    """Further columns of the frame, as expressions of the others."""
    tables: tuple[StudyTable, ...] = msgspec.field(name="table", default=())
    figures: tuple[StudyFigure, ...] = msgspec.field(name="figure", default=())

    def __post_init__(self) -> None:
        check_known(self.program, PROGRAMS, "program: no")
        for name, count in Counter(case.name for case in self.cases).items():
            if count > 1:
                raise ValueError(f"cases: two are named {name!r}")
        for axis in {*self.label_names, *self.grid} & {"case", "walk", "seed", "draw", "key"}:
            raise ValueError(f"an axis can't be named {axis!r}")
        for axis in self.grid.keys() & {*self.label_names}:
            raise ValueError(f"labels: {axis!r} is an axis of the grid")
        for case in self.cases:
            for axis, names in case.only.items():
                where = f"case {case.name!r}: only"
                check_known(axis, self.grid, f"{where}: no axis")
                for name in names:
                    check_known(name, self.grid[axis], f"{where}.{axis}: no choice")

    @property
    def label_names(self) -> list[str]:
        """The columns of the frame that are the labels of cases."""
        return list(dict.fromkeys(name for case in self.cases for name in case.labels))


def load_study(name: str) -> Study:
    """Load a study by its name in `configs/experiments`, or by its file.

    Raises:
        ConfigError: One line with the file, the key and the allowed values.
    """
    path = given_file(name, "experiment")
    study = load_table(path, Study, lambda raw: _locate(raw, path))
    cases = (
        case if case.scenario else msgspec.structs.replace(case, scenario=study.scenario)
        for case in study.cases
    )
    return msgspec.structs.replace(study, cases=tuple(cases))


def _locate(raw: dict[str, Any], path: Path, depth: int = 0) -> None:
    """Make the paths of a study absolute, and add the keys of the study that it extends."""
    cases = raw.get("cases")
    for table in (raw, *(cases if isinstance(cases, list) else ())):
        scenario = table.get("scenario") if isinstance(table, dict) else None
        if isinstance(scenario, str):
            is_name = re.fullmatch(r"[\w-]+", scenario)
            file = named_file(scenario, "scenario", f"{path}: ") if is_name else None
            table["scenario"] = str((file or path.parent / scenario).resolve())
    if isinstance(files := raw.get("files"), str):
        patterns = [str(folder / files) for folder in (path.parent.resolve(), PACKAGE)]
        raw["files"] = next(filter(matching, patterns), patterns[0])
    if isinstance(name := raw.get("extends"), str):
        if depth:
            raise ConfigError(f"{path}: extends: a study that is extended can't extend another")
        base = read_toml(path.parent / name)
        _locate(base, path.parent / name, depth + 1)
        raw |= base | raw


def matching(pattern: str) -> list[Path]:
    """Return the files that an absolute pattern matches, in the order of their names."""
    root = Path(pattern).anchor
    return sorted(Path(root).glob(pattern.removeprefix(root)))


def check_known(
    name: str, known: Iterable[str], problem: str, kind: type[Exception] = ValueError
) -> None:
    """Raise an exception of a `kind` if a name is not known, with the known names."""
    if name not in (known := list(known)):
        hint = suggestion(name, known)
        raise kind(f"{problem} {name!r}; {hint}allowed: {', '.join(known) or 'none'}")
