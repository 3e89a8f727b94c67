"""Experiments and searches from TOML files, as strict as scenarios."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from mecazen.errors import ConfigError
from mecazen.loading import given_file
from mecazen.schema import Finite, Positive, Section

from mecazen_experiments.scores import Score

Seed = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
Runs = Annotated[int, msgspec.Meta(ge=1, le=1_000_000)]
Name = Annotated[str, msgspec.Meta(min_length=1)]
Settings = tuple[str, ...]
"""Overrides `key=value`, as in `--set`."""


class BaseCase(Section):
    """A scenario, its overrides, and the reference values of its scores."""

    name: Name
    scenario: Path
    """The scenario's file, relative to this one."""
    settings: Settings = msgspec.field(name="set", default=())
    published: dict[str, Positive] = msgspec.field(default_factory=dict)
    """Published means of scores."""
    limits: dict[str, Positive] = msgspec.field(default_factory=dict)
    """Upper limits of means of scores."""

    def __post_init__(self) -> None:
        for key, scores in (("published", self.published), ("limits", self.limits)):
            for score in scores.keys() - set(Score.__struct_fields__):
                known = ", ".join(Score.__struct_fields__)
                raise ValueError(f"{key}: unknown score {score!r}; allowed: {known}")


class Case(BaseCase):
    """A case of an experiment."""

    sweep: dict[str, tuple[bool | int | float | str, ...]] = msgspec.field(default_factory=dict)
    """Settings with several values each: the case is run for each combination."""
    reference: Name | None = None
    """The case to whose D_err that of this one is related."""
    max_ratio: Positive | None = None
    """Upper limit of that ratio."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.max_ratio is not None and self.reference is None:
            raise ValueError("max_ratio needs a reference")

    @property
    def sweeps(self) -> dict[str, tuple[str, ...]]:
        """The sweep with its values in TOML, as `--sweep` gives them."""
        return {
            key: tuple(json.dumps(value, ensure_ascii=False) for value in values)
            for key, values in self.sweep.items()
        }


class Experiment(Section):
    """Cases, each run once for each seed."""

    cases: Annotated[tuple[Case, ...], msgspec.Meta(min_length=1)]
    seeds: Runs = 30
    """How many: the seeds are 1, 2, … up to this."""

    def __post_init__(self) -> None:
        _check_names(self.cases)
        plain = {case.name for case in self.cases if not case.sweep}
        for case in self.cases:
            if case.reference is not None and case.reference not in plain:
                raise ValueError(
                    f"case {case.name!r}: reference {case.reference!r} is no case without a sweep"
                )


class Range(Section):
    """The range of a parameter."""

    low: Finite
    high: Finite
    log: bool = False
    """Search on a logarithmic scale."""
    prefer: Positive | None = None
    """The preferred value among equally good ones."""
    also: dict[str, Finite] = msgspec.field(default_factory=dict)
    """Other settings that are this parameter times a factor."""

    def __post_init__(self) -> None:
        if self.high <= self.low:
            raise ValueError(f"high = {self.high:g} must be above low = {self.low:g}")
        if self.low <= 0 and (self.log or self.prefer is not None):
            raise ValueError(f"low = {self.low:g} must be above 0 with log or prefer")


class TunedCase(BaseCase):
    """A case of a search."""

    parameters: dict[str, Range] = msgspec.field(default_factory=dict)
    """Settings searched for this case only."""


class Tuning(Section):
    """A search for the best settings."""

    cases: Annotated[tuple[TunedCase, ...], msgspec.Meta(min_length=1)]
    training_seeds: Annotated[tuple[Seed, ...], msgspec.Meta(min_length=1)]
    """The seeds of the search."""
    held_out_seeds: Annotated[tuple[Seed, ...], msgspec.Meta(min_length=1)]
    """The seeds of the report."""
    trials: Runs = 100
    objective: Literal["match", "limits"] = "limits"
    """`match` approaches the published means; `limits` stays far below the limits."""
    parameters: dict[str, Range] = msgspec.field(default_factory=dict)
    """Settings searched, with the same values for all cases."""

    def __post_init__(self) -> None:
        _check_names(self.cases)
        both = set(self.training_seeds) & set(self.held_out_seeds)
        if both:
            raise ValueError(f"held_out_seeds: {min(both)} is a training seed too")
        if not any((self.parameters, *(case.parameters for case in self.cases))):
            raise ValueError("parameters: nothing to search")
        wanted = "published" if self.objective == "match" else "limits"
        for case in self.cases:
            if not getattr(case, wanted):
                raise ValueError(
                    f"case {case.name!r} needs {wanted} for objective = {self.objective!r}"
                )


def experiment_path(name: str) -> Path:
    """Return the file of an experiment given by its path or its name in `configs/experiments`.

    Raises:
        ConfigError: There is no such file.
    """
    return given_file(name, "experiment")


def parse_sweeps(options: Iterable[str]) -> Mapping[str, tuple[str, ...]]:
    """Return the values of each `--sweep KEY=V1,V2`, by key.

    Raises:
        ConfigError: It is not of that form.
    """
    sweeps = {}
    for option in options:
        key, equals, values = option.partition("=")
        sweeps[key.strip()] = tuple(value.strip() for value in values.split(","))
        if not (key.strip() and equals and all(sweeps[key.strip()])):
            raise ConfigError(f"--sweep {option}: must be key.path=value,value")
    return sweeps


def _check_names(cases: Iterable[BaseCase]) -> None:
    for name, count in Counter(case.name for case in cases).items():
        if count > 1:
            raise ValueError(f"cases: two are named {name!r}")
