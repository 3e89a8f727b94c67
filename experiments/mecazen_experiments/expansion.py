"""The runs of a study: one job for each case, choice of the grid, value of the sweep, and seed."""

from __future__ import annotations

import hashlib
import json
import math
import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

from mecazen.config import Scenario
from mecazen.config.people import Recorded
from mecazen.errors import ConfigError
from mecazen.files import read_bytes, to_value
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario, parse_settings
from mecazen_people.paths import make_path

from mecazen_experiments.study import (
    PROGRAMS,
    Case,
    Label,
    Settings,
    Study,
    check_known,
    matching,
)
from mecazen_experiments.versions import fingerprint, version, with_content


class Job(NamedTuple):
    """One run: a row of the study's frame."""

    program: str
    """The name in `study.PROGRAMS` of the function that simulates and measures it."""
    labels: Mapping[str, Label]
    """Columns of the frame: the case, its labels, the choices of the grid, and swept settings."""
    row: str
    """The case, the choices and the swept settings in words."""
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
    only: Iterable[str] = (),
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
        only: Labels `AXIS=NAME`, the first axis is `case`; of each named axis only these are run.
    """
    seeds = seeds or range(study.first_seed, study.first_seed + study.seeds)
    files = files or _files(study)
    swept = {key: tuple(map(to_value, values)) for key, values in study.sweep.items()}
    swept |= sweeps or {}
    rows = []
    for case in study.cases:
        axes = [case.only.get(axis, tuple(choices)) for axis, choices in study.grid.items()]
        for choice in product(*axes, *swept.values()):
            values = dict(zip((*study.grid, *swept), choice, strict=True))
            labels = {"case": case.name}
            labels |= {name: case.labels.get(name, "") for name in study.label_names}
            rows.append((case, values, labels | values))
    code = version(PROGRAMS[study.program])
    jobs: list[Job] = []
    for case, values, labels in _chosen(rows, only):
        chosen = (setting for axis in study.grid for setting in study.grid[axis][values[axis]])
        base = (*study.settings, *chosen, *case.settings)
        overrides = (*(f"{key}={values[key]}" for key in swept), *settings)
        place = _place(case, base, overrides)
        words = (f"{key}={value}" if key in swept else value for key, value in values.items())
        row = ", ".join((case.name, *words))
        columns = {key: _scalar(text) if key in swept else text for key, text in labels.items()}
        uses_seed = case.vary or any("$seed" in setting for setting in base)
        for group in [[seed] for seed in seeds] if uses_seed else [seeds]:
            full = (*_filled(case, base, place, group[0]), *overrides)
            for file, walked, content in _variants(case.scenario, full, files):
                for seed in group:
                    parts = json.dumps((study.program, content, seed, code))
                    key = hashlib.sha256(parts.encode()).hexdigest()[:16]
                    options = walked if case.scenario is None else (*walked, f"seed={seed}")
                    part = (study.program, columns, row, seed, file, case.scenario)
                    jobs.append(Job(*part, options, key, code))
    if files and not any(job.file for job in jobs):
        raise ConfigError(
            f"{files[0].parent}: no case of the study walks a recorded path: "
            "target.path.kind = 'recorded'"
        )
    return jobs


Row = tuple[Case, dict[str, str], dict[str, str]]
"""A case, the values of the grid and the sweep by axis, and these with the labels of the case."""


def _chosen(rows: Sequence[Row], only: Iterable[str]) -> Iterable[Row]:
    """Return the rows with labels as in `--only AXIS=NAME`."""
    kept: dict[str, list[str]] = {}
    for option in only:
        axis, _, name = option.partition("=")
        if axis not in rows[0][2]:
            axes = ", ".join(rows[0][2])
            raise ConfigError(f"--only {option}: no such axis; allowed: {axes}")
        known = dict.fromkeys(labels[axis] for *_, labels in rows)
        check_known(name, known, f"--only {axis}: unknown", ConfigError)
        kept.setdefault(axis, []).append(name)
    return [row for row in rows if all(row[2][axis] in names for axis, names in kept.items())]


def _variants(
    scenario: Path | None, settings: Settings, files: Sequence[Path]
) -> Iterator[tuple[Path | None, Settings, object]]:
    """Yield each file of a case, the settings with it, and what the result depends on."""
    if scenario is None:
        options = [
            with_content(value) if key.startswith("programs.") and isinstance(value, str) else value
            for key, value in parse_settings(settings).items()
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
        path = load_scenario(scenario, parse_settings(walked)).target.path
        assert isinstance(path, Recorded)
        try:
            end_s = make_path(path).duration
        except ConfigError as error:
            raise ConfigError(f"{walk}: {error}") from None
        # rounding errors do not make the run a tick longer
        ticks = math.ceil(end_s / loaded.sim.tick_s - 1e-6)
        walked = (*walked, f"sim.duration_s={ticks * loaded.sim.tick_s!r}")
        yield walk, walked, fingerprint(load_scenario(scenario, parse_settings(walked)))


def _place(case: Case, settings: Settings, overrides: Settings) -> dict[str, float]:
    """Return the follower's place beside a person at the origin, if the settings use values."""
    if case.scenario is None or not any("$" in setting for setting in settings):
        return {}
    plain = [setting for setting in settings if "$" not in setting]
    loaded = load_scenario(case.scenario, parse_settings((*plain, *overrides)))
    standoff = loaded.follower.standoff
    x, y, _ = standoff.goal(Pose2D())
    bearing_deg, yaw_deg = math.degrees(standoff.bearing), math.degrees(standoff.heading)
    return {"bearing_deg": bearing_deg, "x_m": x, "y_m": y, "yaw_deg": yaw_deg}


def _filled(case: Case, settings: Settings, place: Mapping[str, float], seed: int) -> list[str]:
    """Return settings with the values of a seed."""
    chance = random.Random(f"{case.name} {seed}")  # noqa: S311
    values = {**case.values, **place, "seed": seed}
    values |= {name: chance.uniform(*limits) for name, limits in case.vary.items()}
    try:
        return [Template(setting).substitute(values) for setting in settings]
    except (KeyError, ValueError) as error:
        where = f"case {case.name!r}: set"
        raise ConfigError(f"{where}: no value {error}; known: {', '.join(values)}") from None


def _files(study: Study) -> list[Path]:
    files = matching(study.files) if study.files else []
    if study.files and not files:
        raise ConfigError(f"files: no file matches {study.files}")
    return files


def _scalar(value: str) -> Label:
    """Return a swept value as a number, or true or false, if it is one."""
    try:
        scalar: Label = json.loads(value)
    except ValueError:
        return value
    return scalar
