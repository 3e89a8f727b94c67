"""A study: scenarios, settings, grid, seeds, tables and figures, in one TOML file."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, cast, get_args

import msgspec
from mecazen.errors import ConfigError
from mecazen.explain import suggestion
from mecazen.files import to_value
from mecazen.loading import given_file, load_table, named_file
from mecazen.schema import Finite, Positive, Section

Seed = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
Runs = Annotated[int, msgspec.Meta(ge=1, le=1_000_000)]
Name = Annotated[str, msgspec.Meta(min_length=1)]
Settings = tuple[str, ...]
"""Overrides `key=value`, as in `--set`; an entry without `=` is the name of named settings."""
Label = bool | int | float | str
How = Literal["mean", "share", "sum", "min", "max", "value", "difference", "ratio", "most_per_hour"]
"""The way in which a column of a table summarises the runs of a row."""
PACKAGE = Path(__file__).parent
STRING = re.compile(r""""[^"]*"|'[^']*'|^[^\[{"']+$""")
"""Each string in a value of TOML; a bare word is one."""


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
    only: dict[Name, tuple[str, ...]] = msgspec.field(default_factory=dict)
    """The choices of an axis of the grid that this case runs with; all of other axes."""
    published: dict[Name, Positive] = msgspec.field(default_factory=dict)
    """Published means of scores: the columns `published_SCORE`."""
    limits: dict[Name, Positive] = msgspec.field(default_factory=dict)
    """Upper limits of means of scores, or of their ratios as `SCORE_ratio`."""


class Column(NamedTuple):
    """A column of a table."""

    header: str
    name: str
    """A column of the frame."""
    digits: int
    """Decimals."""
    how: How = "mean"


class StudyTable(Section):
    """A table: its rows, and the columns of scores."""

    columns: Annotated[tuple[tuple[Any, ...], ...], msgspec.Meta(min_length=1)]
    """[header, name, digits], or [header, name, digits, how]."""
    title: str = ""
    where: str = ""
    """A query of the frame, such as `view == 'back'`; all runs if empty."""
    rows: tuple[str, ...] = ()
    """Columns of the frame; each combination of their values is a row. Without any, all runs are
    one row."""
    unit: str | tuple[str, ...] = ("case", "draw")
    """Columns whose values make an independent unit: the mean over the runs of a unit is taken
    first. `draw` is the walk, or the seed without a walk."""
    each: dict[Name, tuple[str, ...]] = msgspec.field(default_factory=dict)
    """Words that replace `{NAME}` in the names of columns: a row for each word."""
    reference: dict[Name, Label] = msgspec.field(default_factory=dict)
    """The row that `difference` and `ratio` compare with: it has these values, and the other
    values of the row."""
    note: str = ""
    """A sentence below the table."""

    def __post_init__(self) -> None:
        for column in self.columns:
            if not _is_column(column):
                raise ValueError(
                    f"table {self.title!r}: column {list(column)}: must be [header, name, digits] "
                    f"or [header, name, digits, how] with how = {' or '.join(get_args(How))}"
                )
        compared = {column.how for column in self.shown} & {"difference", "ratio"}
        if compared and not self.reference:
            raise ValueError(f"table {self.title!r}: {min(compared)!r} needs a reference")
        for name in self.reference.keys() - {*self.rows}:
            raise ValueError(
                f"table {self.title!r}: reference: {name} is not one of rows = {list(self.rows)}"
            )

    @property
    def shown(self) -> list[Column]:
        """The columns."""
        return [Column(*column) for column in self.columns]

    @property
    def units(self) -> list[str]:
        """The columns of the unit."""
        return [self.unit] if isinstance(self.unit, str) else list(self.unit)


class StudyFigure(Section):
    """A figure of the runs' scores, or of single runs."""

    name: Annotated[str, msgspec.Meta(pattern=r"^[\w-]+$")]
    """The name of the file."""
    kind: str = "points"
    """A name in `figures.KINDS`."""
    x: str = ""
    """A column of the frame."""
    y: str | tuple[str, ...] = ()
    """Columns of the frame: a panel for each."""
    by: str = ""
    """A column of the frame: a colour for each value."""
    where: str = ""
    """A query of the frame, as in tables."""
    unit: str | tuple[str, ...] = ("case", "draw")
    title: str = ""
    labels: tuple[str, ...] = ()
    """The labels of the axes of x and each y; the names of the columns by default."""

    @property
    def panels(self) -> list[str]:
        """The columns of y."""
        return [self.y] if isinstance(self.y, str) else list(self.y)


class Study(Section):
    """Cases, each run for each combination of grid and sweep, once for each seed."""

    cases: Annotated[tuple[Case, ...], msgspec.Meta(min_length=1)]
    program: Name = "following"
    """The program of a run, a name in `programs.PROGRAMS`."""
    seeds: Runs = 30
    """Number of seeds."""
    first_seed: Seed = 1
    """First seed; the others are consecutive."""
    scenario: Path | None = None
    """The scenario of cases that name none."""
    settings: Settings = msgspec.field(name="set", default=())
    """Settings of all cases."""
    named: dict[Name, Settings] = msgspec.field(default_factory=dict)
    """Settings that `set` and `grid` may use by their name."""
    grid: dict[Name, Annotated[dict[Name, Settings], msgspec.Meta(min_length=1)]] = msgspec.field(
        default_factory=dict
    )
    """Axes of named choices, such as a view or a driver."""
    sweep: dict[Name, tuple[Label, ...]] = msgspec.field(default_factory=dict)
    """Settings with several values each."""
    files: str = ""
    """A pattern relative to the study's file, or else to this package: each matching file makes its
    own runs, and is the `file` of their jobs."""
    derive: dict[Name, str] = msgspec.field(default_factory=dict)
    """Further columns of the frame, as expressions of the others."""
    tables: tuple[StudyTable, ...] = msgspec.field(name="table", default=())
    figures: tuple[StudyFigure, ...] = msgspec.field(name="figure", default=())

    def __post_init__(self) -> None:
        for name, count in Counter(case.name for case in self.cases).items():
            if count > 1:
                raise ValueError(f"cases: two are named {name!r}")
        labels = [name for case in self.cases for name in case.labels]
        for axis in {*labels, *self.grid} & {"case", "walk", "seed", "draw", "key"}:
            raise ValueError(f"an axis can't be named {axis!r}")
        for axis in self.grid.keys() & {*labels}:
            raise ValueError(f"labels: {axis!r} is an axis of the grid")
        for case in self.cases:
            for axis, names in case.only.items():
                where = f"case {case.name!r}: only"
                check_known(axis, self.grid, f"{where}: no axis")
                for name in names:
                    check_known(name, self.grid[axis], f"{where}.{axis}: no choice")
        every = [self.settings, *(case.settings for case in self.cases), *self.named.values()]
        every += [settings for axis in self.grid.values() for settings in axis.values()]
        for setting in (setting for settings in every for setting in settings):
            if "=" not in setting:
                check_known(setting, self.named, "set: no '=' and no named settings")

    @property
    def label_names(self) -> list[str]:
        """The columns of the frame that are the labels of cases."""
        return list(dict.fromkeys(name for case in self.cases for name in case.labels))

    def all_of(self, *settings: Settings) -> list[str]:
        """Return the overrides of settings in a row, with named ones in full."""
        full = []
        for setting in (setting for part in settings for setting in part):
            full += self.all_of(self.named[setting]) if "=" not in setting else [setting]
        return full


def load_study(path: Path) -> Study:
    """Load a study, with the scenarios and files that it names.

    A path in `set`, `named` or `grid` is relative to the file, if there is such a file.

    Raises:
        ConfigError: One line with the file, the key and the allowed values.
    """

    def absolute(text: re.Match[str]) -> str:
        name, colon, suffix = text[0].strip("\"' ").partition(":")
        file = (path.parent / name).resolve()
        return to_value(f"{file}{colon}{suffix}") if "." in name and file.is_file() else text[0]

    def located(settings: Any) -> Any:
        if isinstance(settings, dict):
            return {name: located(value) for name, value in settings.items()}
        if isinstance(settings, list):
            return [located(value) for value in settings]
        if not isinstance(settings, str):
            return settings
        key, equals, value = settings.partition("=")
        return key + equals + STRING.sub(absolute, value)

    def prepare(raw: dict[str, Any]) -> None:
        listed = raw.get("cases")
        for table in (raw, *(listed if isinstance(listed, list) else ())):
            if not isinstance(table, dict):
                continue
            name = table.get("scenario")
            if isinstance(name, str) and re.fullmatch(r"[\w-]+", name):
                table["scenario"] = str(named_file(name, "scenario", f"{path}: ").resolve())
            for key in table.keys() & {"set", "grid", "named"}:
                table[key] = located(table[key])

    study = load_table(path, Study, prepare)
    if study.scenario is not None:
        cases = (
            case if case.scenario else msgspec.structs.replace(case, scenario=study.scenario)
            for case in study.cases
        )
        study = msgspec.structs.replace(study, cases=tuple(cases))
    if study.files:
        patterns = [str(folder / study.files) for folder in (path.parent.resolve(), PACKAGE)]
        pattern = next(filter(matching, patterns), patterns[0])
        study = msgspec.structs.replace(study, files=pattern)
    return study


def matching(pattern: str) -> list[Path]:
    """Return the files that an absolute pattern matches, in the order of their names."""
    root = Path(pattern).anchor
    return sorted(Path(root).glob(pattern.removeprefix(root)))


def study_path(name: str) -> Path:
    """Return the file of a study given by its path or its name in `configs/experiments`."""
    return given_file(name, "experiment")


def parse_sweeps(options: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return the values of each `--sweep KEY=V1,V2`, by key."""
    sweeps = {}
    for option in options:
        key, equals, values = option.partition("=")
        sweeps[key.strip()] = tuple(value.strip() for value in values.split(","))
        if not (key.strip() and equals and all(sweeps[key.strip()])):
            raise ConfigError(f"--sweep {option}: must be key.path=value,value")
    return sweeps


def chosen(study: Study, options: Iterable[str]) -> Study:
    """Return a study with the choices of its axes that `--only AXIS=NAME` names.

    The first axis is `case`; several choices of one axis are all kept.
    """
    axes = {"case": [case.name for case in study.cases]}
    axes |= {
        name: [case.labels.get(name, "") for case in study.cases] for name in study.label_names
    }
    axes |= {axis: [*choices] for axis, choices in study.grid.items()}
    kept: dict[str, list[str]] = {}
    for option in options:
        axis, _, name = option.partition("=")
        if axis not in axes:
            raise ConfigError(f"--only {option}: no such axis; allowed: {', '.join(axes)}")
        check_known(name, dict.fromkeys(axes[axis]), f"--only {axis}: unknown", ConfigError)
        kept.setdefault(axis, []).append(name)
    axes |= {axis: [name for name in axes[axis] if name in names] for axis, names in kept.items()}
    return msgspec.structs.replace(
        study,
        cases=tuple(
            msgspec.structs.replace(
                case,
                only={
                    axis: tuple(name for name in names if name in axes[axis])
                    for axis, names in case.only.items()
                },
            )
            for case in study.cases
            if case.name in axes["case"]
            and all(case.labels.get(name, "") in axes[name] for name in study.label_names)
        ),
        grid={
            axis: {name: choices[name] for name in axes[axis]}
            for axis, choices in study.grid.items()
        },
    )


def _is_column(column: tuple[Any, ...]) -> bool:
    if len(column) not in (3, 4) or not all(isinstance(text, str) for text in column[:2]):
        return False
    digits, how = cast(Any, column[2]), column[3] if len(column) == 4 else "mean"
    return isinstance(digits, int) and 0 <= digits <= 9 and how in get_args(How)


def check_known(
    name: str, known: Iterable[str], problem: str, kind: type[Exception] = ValueError
) -> None:
    """Raise an exception of a `kind` if a name is not known, with the known names."""
    if name not in (known := list(known)):
        hint = suggestion(name, known)
        raise kind(f"{problem} {name!r}; {hint}allowed: {', '.join(known) or 'none'}")
