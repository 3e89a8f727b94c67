"""Cases expanded to runs, each with a key under which its result is stored."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import math
import platform
import random
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import version as version_of
from itertools import product
from pathlib import Path
from string import Template
from typing import Any, NamedTuple, cast

import msgspec
from mecazen.config import Scenario
from mecazen.config.people import Recorded
from mecazen.errors import ConfigError, MecazenError
from mecazen.files import read_bytes, to_value
from mecazen.geometry import Pose2D
from mecazen.loading import load_scenario, parse_settings
from mecazen.schema import OutputFile
from mecazen_people.paths import make_path
from mecazen_tools import files
from mecazen_tools.simulation import in_lockstep

from mecazen_experiments.config import Case, Experiment, Settings, Sweep

PACKAGES = (
    *("mecazen", "mecazen_people", "mecazen_tools", "mecazen_experiments"),
    *("mecazen_physics", "mecazen_controller", "mecazen_target"),
    *("mecazen_sensors", "mecazen_follower", "mecazen_guard"),
)
"""The packages whose code and data a result depends on."""
LIBRARIES = ("dartpy", "filterpy", "msgspec", "mujoco", "numpy", "scipy")
"""Libraries that a result depends on."""


class Key(msgspec.Struct, frozen=True):
    """All that the result of a run depends on; see `fingerprint` and `version`."""

    scenario_sha256: str
    seed: int
    version: str


class Job(msgspec.Struct, frozen=True):
    """One run."""

    row: str
    """The row of the table that the run belongs to."""
    walk: str | None
    """The recorded walk that was given for the run, if any."""
    scenario: Path
    settings: Settings
    key: Key

    def load(self) -> Scenario:
        """Return the scenario to simulate."""
        return load_scenario(self.scenario, parse_settings(self.settings))

    def __str__(self) -> str:
        walk = f" / {self.walk}" if self.walk else ""
        return f"{self.row}{walk}, seed {self.key.seed}"


class Series(NamedTuple):
    """The runs of one row of a table."""

    row: str
    case: Case
    jobs: tuple[Job, ...]
    labels: Mapping[str, str | float] = {}
    """The choices that distinguish the row, by axis."""


def expand(
    experiment: Experiment,
    seeds: Sequence[int],
    settings: Settings = (),
    sweeps: Mapping[str, tuple[str, ...]] | None = None,
    walks: Sequence[Path] = (),
) -> list[Series]:
    """Return the runs of each case, for each combination of the grid and the sweeps.

    The settings of an experiment may use values as `$NAME`. These are the values that a case
    varies, drawn by the seed, and the follower's place beside a person at the origin:
    `$bearing_deg`, `$x_m`, `$y_m` and `$yaw_deg`. All rows of a case have the same values for a
    seed, so they can be compared in pairs.

    Args:
        experiment: The experiment.
        seeds: One run per seed.
        settings: Overrides of the settings of every case.
        sweeps: Values in TOML by key; they replace those of the experiment.
        walks: Walks with each of which a case with a recorded walk is run.
    """
    todo = []
    grid = [[(axis, name) for name in choices] for axis, choices in experiment.grid.items()]
    for case, choice in product(experiment.cases, product(*grid)):
        given = [*experiment.settings]
        given += [one for axis, name in choice for one in experiment.grid[axis][name]]
        swept = {**_values(experiment.sweep), **_values(case.sweep), **(sweeps or {})}
        for values in product(*swept.values()):
            changes = tuple(f"{key}={value}" for key, value in zip(swept, values, strict=True))
            row = ", ".join((case.name, *(name for _, name in choice), *changes))
            labels: dict[str, str | float] = {"case": case.name, **dict(choice)}
            labels |= {key: _scalar(value) for key, value in zip(swept, values, strict=True)}
            fill = _filling(case, (*given, *case.settings), (*changes, *settings))
            jobs: list[Job] = []
            for some in [(seed,) for seed in seeds] if case.vary else [seeds]:
                own = (*fill(some[0]), *changes, *settings)
                jobs += jobs_of(row, case.scenario, own, some, walks)
            todo.append(Series(row, case, tuple(jobs), labels))
    if walks and not any(job.walk for row in todo for job in row.jobs):
        raise ConfigError("--walks: the person of no case has target.path.kind = 'recorded'")
    return todo


def _values(sweep: Sweep) -> dict[str, tuple[str, ...]]:
    """Return a sweep with its values in TOML, as in `--sweep`."""
    return {key: tuple(to_value(value) for value in values) for key, values in sweep.items()}


def _scalar(value: str) -> str | float:
    with suppress(ValueError):
        return cast(float, json.loads(value))
    return value


def _filling(case: Case, settings: Settings, others: Settings) -> Callable[[int], Settings]:
    """Return a function that returns settings with the values of a seed."""
    if not any("$" in one for one in settings):
        return lambda _: settings
    plain = [one for one in settings if "$" not in one]
    standoff = load_scenario(case.scenario, parse_settings((*plain, *others))).follower.standoff
    x, y, _ = standoff.goal(Pose2D())
    bearing_deg, yaw_deg = math.degrees(standoff.bearing), math.degrees(standoff.heading)
    place = {"bearing_deg": bearing_deg, "x_m": x, "y_m": y, "yaw_deg": yaw_deg}

    def fill(seed: int) -> Settings:
        chance = random.Random(f"{case.name} {seed}")  # noqa: S311
        values = place | {name: chance.uniform(*limits) for name, limits in case.vary.items()}
        try:
            return tuple(Template(one).substitute(values) for one in settings)
        except (KeyError, ValueError) as error:
            known = ", ".join(values)
            where = f"case {case.name!r}: set"
            raise ConfigError(f"{where}: no value {error}; known: {known}") from None

    return fill


def jobs_of(
    row: str, file: Path, settings: Settings, seeds: Sequence[int], walks: Sequence[Path] = ()
) -> list[Job]:
    """Return a job for each seed, and for each walk if the scenario has a recorded walk."""
    scenario = load_scenario(file, parse_settings(settings))
    variants: Iterable[tuple[str | None, Settings, str]]
    if walks and isinstance(scenario.target.path, Recorded):
        variants = [_with_walk(file, settings, walk) for walk in walks]
    else:
        variants = [(None, settings, fingerprint(scenario))]
    return [
        Job(row, walk, file, (*changed, f"seed={seed}"), Key(sha256, seed, version()))
        for walk, changed, sha256 in variants
        for seed in seeds
    ]


def _with_walk(scenario: Path, settings: Settings, walk: Path) -> tuple[str, Settings, str]:
    """Return the walk's name, the settings with it and its duration, and their fingerprint."""
    settings = (*settings, f"target.path.file={msgspec.json.encode(str(walk.resolve())).decode()}")
    loaded = load_scenario(scenario, parse_settings(settings))
    path = loaded.target.path
    assert isinstance(path, Recorded)
    try:
        end_s = make_path(path).duration
    except ConfigError as error:
        raise ConfigError(f"{walk}: {error}") from None
    # rounding errors do not make the run a tick longer
    ticks = math.ceil(end_s / loaded.sim.tick_s - 1e-6)
    settings = (*settings, f"sim.duration_s={ticks * loaded.sim.tick_s!r}")
    return walk.stem, settings, fingerprint(load_scenario(scenario, parse_settings(settings)))


def fingerprint(scenario: Scenario) -> str:
    """Return the SHA-256 of a scenario without its seed.

    The hash covers canonical JSON in which each file (a recorded walk, a user's program) is
    represented by its content instead of its name. Imports of a user's program are not covered.
    """
    scenario = msgspec.structs.replace(
        in_lockstep(scenario),
        seed=0,
        programs={part: with_content(name) for part, name in scenario.programs.items()},
    )
    canonical = msgspec.json.encode(scenario, enc_hook=_content, order="sorted")
    return hashlib.sha256(canonical).hexdigest()


def _content(value: Any) -> str:
    if not isinstance(value, Path):
        raise NotImplementedError(f"no way to write {type(value).__name__} as JSON")
    if isinstance(value, OutputFile):
        return str(value)
    return hashlib.sha256(read_bytes(value)).hexdigest()


def with_content(program: str) -> str:
    """Return a program's name, or its class and the content of its file if it has one."""
    place, colon, name = program.partition(":")
    if not colon:
        return program
    if not place.endswith(".py"):
        spec = None
        with suppress(ImportError, ValueError):
            spec = importlib.util.find_spec(place)
        if spec is None or spec.origin is None:
            raise ConfigError(f"{program}: there is no module {place}")
        place = spec.origin
    return f"{_content(Path(place))}:{name}"


@cache
def version() -> str:
    """Return the SHA-256 of the code, the data and the libraries that a result depends on.

    The hash covers all files of `PACKAGES`, and the versions of Python and of `LIBRARIES`.
    """
    lines = [f"python {platform.python_version()}"]
    lines += [f"{name} {version_of(name)}" for name in LIBRARIES]
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        assert spec is not None
        for folder in map(Path, spec.submodule_search_locations or ()):
            lines.append(f"{name} {files.sha256_of(folder, [folder])}")
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def check_version(job: Job) -> None:
    """Raise MecazenError if the code of this process does not have the version in the key."""
    if job.key.version != version():
        raise MecazenError("this worker has other versions of mecazen or of its libraries")
