"""Experiments and searches from TOML files, as strict as scenarios."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from mecazen.errors import ConfigError
from mecazen.files import to_value
from mecazen.loading import given_file, load_table, named_file
from mecazen.schema import Finite, Positive, Section, SectionT

from mecazen_experiments.scores import Score

Seed = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
Runs = Annotated[int, msgspec.Meta(ge=1, le=1_000_000)]
Name = Annotated[str, msgspec.Meta(min_length=1)]
Settings = tuple[str, ...]
"""Overrides `key=value`, as in `--set`."""
Sweep = dict[str, tuple[bool | int | float | str, ...]]
"""Settings with several values each: one run for each combination."""
STRING = re.compile(r""""[^"]*"|'[^']*'|^[^\[{"']+$""")
"""Each string in a value of TOML; a bare word is one."""


class Case(Section):
    """A scenario, its overrides, and the reference values of its scores."""

    name: Name
    scenario: Path
    """The scenario's name, or its file, relative to the experiment's file."""
    settings: Settings = msgspec.field(name="set", default=())
    """Overrides; may use the values `$NAME` of `vary` and of the follower's place: see
    `jobs.expand`."""
    vary: dict[str, tuple[Finite, Finite]] = msgspec.field(default_factory=dict)
    """Values that each seed draws between two limits, by name."""
    sweep: Sweep = msgspec.field(default_factory=dict)
    published: dict[str, Positive] = msgspec.field(default_factory=dict)
    """Published means of scores."""
    limits: dict[str, Positive] = msgspec.field(default_factory=dict)
    """Upper limits of means of scores."""
    reference: Name | None = None
    """The case whose D_err is the denominator of this case's D_err ratio."""
    max_ratio: Positive | None = None
    """Upper limit of that ratio."""

    def __post_init__(self) -> None:
        for key, scores in (("published", self.published), ("limits", self.limits)):
            for score in scores.keys() - set(Score.__struct_fields__):
                known = ", ".join(Score.__struct_fields__)
                raise ValueError(f"{key}: unknown score {score!r}; allowed: {known}")
        if self.max_ratio is not None and self.reference is None:
            raise ValueError("max_ratio needs a reference")


class Experiment(Section):
    """Cases, each run for each combination of grid and sweeps, once for each seed."""

    cases: Annotated[tuple[Case, ...], msgspec.Meta(min_length=1)]
    kind: Literal["following", "paper", "mocap", "safety"] = "following"
    """How runs are scored and shown: see `kinds.KINDS`."""
    settings: Settings = msgspec.field(name="set", default=())
    """Settings of all cases; may use the same values as the cases' settings."""
    grid: dict[Name, Annotated[dict[Name, Settings], msgspec.Meta(min_length=1)]] = msgspec.field(
        default_factory=dict
    )
    """Axes of named choices, such as a view or a driver."""
    sweep: Sweep = msgspec.field(default_factory=dict)
    """Sweeps of all cases."""
    seeds: Runs = 30
    """Number of seeds."""
    first_seed: Seed = 1
    """First seed; the others are consecutive."""

    def __post_init__(self) -> None:
        _check_names(self.cases)
        if "case" in self.grid:
            raise ValueError("grid: an axis can't be named 'case'")
        plain = {case.name for case in self.cases if not (case.sweep or self.sweep or self.grid)}
        for case in self.cases:
            if case.reference is not None and case.reference not in plain:
                raise ValueError(
                    f"case {case.name!r}: reference {case.reference!r} is no case without a sweep"
                )


def load_cases(path: Path, kind: type[SectionT]) -> SectionT:
    """Load an experiment or a search, with the scenarios and files that it names.

    A path in `set` or `grid`, also within a list or a table, is relative to the file, if there is
    such a file.
    """

    def absolute(text: re.Match[str]) -> str:
        name, colon, rest = text[0].strip("\"' ").partition(":")
        file = (path.parent / name).resolve()
        return to_value(f"{file}{colon}{rest}") if "." in name and file.is_file() else text[0]

    def located(settings: Any) -> Any:
        if isinstance(settings, dict):
            return {name: located(of) for name, of in settings.items()}
        if isinstance(settings, list):
            return [located(of) for of in settings]
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
            for key in table.keys() & {"set", "grid"}:
                table[key] = located(table[key])

    return load_table(path, kind, prepare)


def experiment_path(name: str) -> Path:
    """Return the file of an experiment given by its path or its name in `configs/experiments`."""
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


def chosen(experiment: Experiment, options: Iterable[str]) -> Experiment:
    """Return an experiment with the choices of its axes that `--only AXIS=NAME` names.

    The first axis is `case`; several choices of one axis are all kept.
    """
    axes = {"case": [case.name for case in experiment.cases]}
    axes |= {axis: [*choices] for axis, choices in experiment.grid.items()}
    kept: dict[str, list[str]] = {}
    for option in options:
        axis, _, name = option.partition("=")
        known = axes.get(axis, [f"{axis}=NAME" for axis in axes])
        if name not in known:
            raise ConfigError(f"--only {option}: unknown; allowed: {', '.join(known)}")
        kept.setdefault(axis, []).append(name)
    axes |= {axis: [name for name in axes[axis] if name in names] for axis, names in kept.items()}
    return msgspec.structs.replace(
        experiment,
        cases=tuple(case for case in experiment.cases if case.name in axes["case"]),
        grid={a: {name: of[name] for name in axes[a]} for a, of in experiment.grid.items()},
    )


def _check_names(cases: Iterable[Case]) -> None:
    for name, count in Counter(case.name for case in cases).items():
        if count > 1:
            raise ValueError(f"cases: two are named {name!r}")
