"""The runs of a study: one job for each case, choice of the grid, value of the sweep, and seed."""

from __future__ import annotations

import hashlib
import json
import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import product
from pathlib import Path
from string import Template
from typing import Any, NamedTuple, cast

from mecazen.config import Scenario
from mecazen.config.people import Recorded
from mecazen.errors import ConfigError
from mecazen.files import read_bytes, to_value
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario, parse_settings
from mecazen_people.paths import make_path

from mecazen_experiments.programs import PROGRAMS
from mecazen_experiments.study import Case, Label, Settings, Study, check_known
from mecazen_experiments.versions import fingerprint, version, with_content


class Job(NamedTuple):
    """One run: a row of the study's frame."""

    program: str
    """The name of the function in `programs.PROGRAMS` that simulates and measures it."""
    labels: Mapping[str, Label]
    """The case, the choices of the grid and the swept settings: columns of the frame."""
    choices: Mapping[str, Label]
    """The labels that distinguish the rows of the study: all but those that a case defines."""
    seed: int
    file: Path | None
    """The recorded walk, or the file of the study's `files`, if there is one."""
    scenario: Path | None
    settings: tuple[str, ...]
    """Overrides of the scenario, with the seed; the program's own options without a scenario."""
    key: str
    """Hash of all that the result depends on."""
    version: str
    """The part of the key for code, data of packages, and libraries."""

    @property
    def walk(self) -> str:
        """The name of the file; empty without one."""
        return "" if self.file is None else self.file.stem

    @property
    def row(self) -> str:
        """The case, the choices and the swept settings in words."""
        return ", ".join(
            f"{name}={value}" if "." in name else str(value) for name, value in self.choices.items()
        )

    def load(self) -> Scenario:
        """Return the scenario to simulate."""
        assert self.scenario is not None, "the case has no scenario"
        return load_scenario(self.scenario, self.options())

    def options(self) -> dict[str, Any]:
        """Return the settings by key."""
        return parse_settings(self.settings)

    def __str__(self) -> str:
        walk = f" / {self.walk}" if self.walk else ""
        return f"{self.row}{walk}, seed {self.seed}"


def expand(
    study: Study,
    seeds: Sequence[int] = (),
    settings: Settings = (),
    sweeps: Mapping[str, tuple[str, ...]] | None = None,
    files: Sequence[Path] = (),
) -> list[Job]:
    """Return the runs of a study, in the order of the frame.

    The settings of a study may use values as `$NAME`: those that a case defines, those that it
    varies, drawn by the seed, `$seed` itself, and the follower's place beside a person at the
    origin (`$bearing_deg`, `$x_m`, `$y_m` and `$yaw_deg`). All rows of a case have the same values
    for a seed, so they can be compared in pairs.

    Args:
        study: The study.
        seeds: One run per seed; the study's seeds if empty.
        settings: Overrides of the settings of every case.
        sweeps: Values in TOML by key; they replace those of the study.
        files: Walks with each of which a case with a recorded walk is run; for cases without a
            scenario, files of their program. By default those of the study.
    """
    check_known(study.program, PROGRAMS, "program: no", ConfigError)
    seeds = seeds or range(study.first_seed, study.first_seed + study.seeds)
    files = files or _files(study)
    swept = {key: tuple(map(to_value, values)) for key, values in study.sweep.items()}
    swept |= sweeps or {}
    jobs: list[Job] = []
    for case in study.cases:
        axes = [
            [(axis, name) for name in case.only.get(axis, tuple(choices))]
            for axis, choices in study.grid.items()
        ]
        for choice, values in product(product(*axes), product(*swept.values())):
            changes = tuple(f"{key}={value}" for key, value in zip(swept, values, strict=True))
            labels: dict[str, Label] = {"case": case.name}
            labels |= {name: case.labels.get(name, "") for name in study.label_names}
            labels |= dict(choice)
            labels |= {key: _scalar(value) for key, value in zip(swept, values, strict=True)}
            chosen = (study.grid[axis][name] for axis, name in choice)
            base = tuple(study.all_of(study.settings, *chosen, case.settings))
            fill = _filling(case, base, (*changes, *settings))
            uses_seed = case.vary or any("$seed" in setting for setting in base)
            for group in [(seed,) for seed in seeds] if uses_seed else [seeds]:
                full = (*fill(group[0]), *changes, *settings)
                jobs += _jobs(study, labels, case, full, group, files)
    if files and not any(job.file for job in jobs):
        raise ConfigError(
            f"{files[0].parent}: no case of the study walks a recorded path: "
            "target.path.kind = 'recorded'"
        )
    return jobs


def _jobs(
    study: Study,
    labels: Mapping[str, Label],
    case: Case,
    settings: Settings,
    seeds: Sequence[int],
    files: Sequence[Path],
) -> Iterator[Job]:
    """Yield a job for each file and seed."""
    program = study.program
    code = version(PROGRAMS[program])
    choices = {name: value for name, value in labels.items() if name not in case.labels}
    for file, changed, content in _variants(case.scenario, settings, files):
        for seed in seeds:
            parts = json.dumps((program, content, seed, code))
            key = hashlib.sha256(parts.encode()).hexdigest()[:16]
            full = changed if case.scenario is None else (*changed, f"seed={seed}")
            yield Job(program, labels, choices, seed, file, case.scenario, full, key, code)


def _variants(
    scenario: Path | None, settings: Settings, files: Sequence[Path]
) -> Iterator[tuple[Path | None, Settings, object]]:
    """Yield each file of a case, the settings with it, and what the result depends on."""
    if scenario is None:
        options = [
            with_content(value) if isinstance(value, str) and ".py:" in value else value
            for value in parse_settings(settings).values()
        ]
        for file in files or (None,):
            content = None if file is None else hashlib.sha256(read_bytes(file)).hexdigest()
            yield file, settings, [settings, options, content]
        return
    loaded = load_scenario(scenario, parse_settings(settings))
    if not (files and isinstance(loaded.target.path, Recorded)):
        yield None, settings, fingerprint(loaded)
        return
    for walk in files:
        walked = (*settings, f"target.path.file={to_value(str(walk.resolve()))}")
        loaded = load_scenario(scenario, parse_settings(walked))
        path = loaded.target.path
        assert isinstance(path, Recorded)
        try:
            end_s = make_path(path).duration
        except ConfigError as error:
            raise ConfigError(f"{walk}: {error}") from None
        # rounding errors do not make the run a tick longer
        ticks = math.ceil(end_s / loaded.sim.tick_s - 1e-6)
        walked = (*walked, f"sim.duration_s={ticks * loaded.sim.tick_s!r}")
        yield walk, walked, fingerprint(load_scenario(scenario, parse_settings(walked)))


def _filling(case: Case, settings: Settings, overrides: Settings) -> Callable[[int], Settings]:
    """Return a function that returns settings with the values of a seed."""
    if not any("$" in setting for setting in settings):
        return lambda _: settings
    values: dict[str, object] = dict(case.values)
    if case.scenario is not None:
        plain = [setting for setting in settings if "$" not in setting]
        loaded = load_scenario(case.scenario, parse_settings((*plain, *overrides)))
        standoff = loaded.follower.standoff
        x, y, _ = standoff.goal(Pose2D())
        bearing_deg, yaw_deg = math.degrees(standoff.bearing), math.degrees(standoff.heading)
        values |= {"bearing_deg": bearing_deg, "x_m": x, "y_m": y, "yaw_deg": yaw_deg}

    def fill(seed: int) -> Settings:
        chance = random.Random(f"{case.name} {seed}")  # noqa: S311
        drawn = {name: chance.uniform(*limits) for name, limits in case.vary.items()}
        drawn["seed"] = seed
        try:
            return tuple(Template(setting).substitute(values | drawn) for setting in settings)
        except (KeyError, ValueError) as error:
            known = ", ".join((*values, *case.vary))
            where = f"case {case.name!r}: set"
            raise ConfigError(f"{where}: no value {error}; known: {known}") from None

    return fill


def _files(study: Study) -> list[Path]:
    if not study.files:
        return []
    above = Path(study.files).anchor
    files = sorted(Path(above).glob(study.files.removeprefix(above)))
    if not files:
        raise ConfigError(f"files: no file matches {study.files}")
    return files


def _scalar(value: str) -> Label:
    with suppress(ValueError):
        return cast(Label, json.loads(value))
    return value
