"""Cases expanded to runs, each with a key under which its result is stored."""

from __future__ import annotations

import hashlib
import importlib.util
import math
import pkgutil
import platform
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import version as version_of
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from mecazen.config import Scenario
from mecazen.config.people import Recorded
from mecazen.errors import ConfigError, MecazenError
from mecazen.files import read_bytes
from mecazen.loading import load_scenario
from mecazen.schema import Output
from mecazen_people.paths import make_path
from mecazen_tools.simulate import in_lockstep

from mecazen_experiments.config import BaseCase, Case, Settings

LIBRARIES = ("dartpy", "filterpy", "msgspec", "numpy", "scipy")
"""Those that a result depends on."""


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
    """The recorded walk that was given for it, if one was."""
    scenario: Path
    settings: Settings
    key: Key

    def __str__(self) -> str:
        walk = f" / {self.walk}" if self.walk else ""
        return f"{self.row}{walk}, seed {self.key.seed}"


class Series(NamedTuple):
    """The runs of one row of a table."""

    row: str
    case: BaseCase
    jobs: tuple[Job, ...]
    labels: Mapping[str, str | float] = {}
    """Properties that distinguish the row, by name."""


def expand(
    cases: Iterable[Case],
    seeds: Sequence[int],
    settings: Settings = (),
    sweeps: Mapping[str, tuple[str, ...]] | None = None,
    walks: Sequence[Path] = (),
) -> list[Series]:
    """Return the runs of cases, and of each combination of their sweeps.

    `settings` override those of every case. `sweeps`, values in TOML by key, replace its own. A
    case whose person walks a recorded walk is run with each of `walks`.

    Raises:
        ConfigError: A scenario can't be loaded, or no case uses the walks that are given.
    """
    rows = []
    for case in cases:
        swept = {**case.sweeps, **(sweeps or {})}
        for values in product(*swept.values()):
            changes = tuple(f"{key}={value}" for key, value in zip(swept, values, strict=True))
            row = ", ".join((case.name, *changes))
            rows.append(series(case, row, (*settings, *changes), seeds, walks))
    if walks and not any(job.walk for row in rows for job in row.jobs):
        raise ConfigError("--walks: the person of no case has target.path.kind = 'recorded'")
    return rows


def series(
    case: BaseCase, row: str, settings: Settings, seeds: Sequence[int], walks: Sequence[Path] = ()
) -> Series:
    """Return the runs of one row: each seed, of each walk where the case has one.

    Raises:
        ConfigError: The scenario can't be loaded.
    """
    settings = (*case.settings, *settings)
    scenario = load_scenario(case.scenario, settings)
    variants: Iterable[tuple[str | None, Settings, str]]
    if walks and isinstance(scenario.target.path, Recorded):
        variants = [_with_walk(case.scenario, settings, walk) for walk in walks]
    else:
        variants = [(None, settings, fingerprint(scenario))]
    jobs = [
        Job(row, walk, case.scenario, (*changed, f"seed={seed}"), Key(sha256, seed, version()))
        for walk, changed, sha256 in variants
        for seed in seeds
    ]
    return Series(row, case, tuple(jobs))


def _with_walk(scenario: Path, settings: Settings, walk: Path) -> tuple[str, Settings, str]:
    """Return the walk's name, the settings with it and its duration, and their fingerprint."""
    settings = (*settings, f"target.path.file={msgspec.json.encode(str(walk.resolve())).decode()}")
    loaded = load_scenario(scenario, settings)
    path = loaded.target.path
    assert isinstance(path, Recorded)
    try:
        end_s = make_path(path).duration
    except ConfigError as error:
        raise ConfigError(f"{walk}: {error}") from None
    # rounding does not make the run a tick longer
    ticks = math.ceil(end_s / loaded.sim.tick_s - 1e-6)
    settings = (*settings, f"sim.duration_s={ticks * loaded.sim.tick_s!r}")
    return walk.stem, settings, fingerprint(load_scenario(scenario, settings))


def fingerprint(scenario: Scenario) -> str:
    """Return the SHA-256 of a scenario without its seed.

    It covers canonical JSON in which each file (a recorded walk, a user's program) is
    represented by its content instead of its name. Imports of such a program do not count.

    Raises:
        ConfigError: A program can't be found.
    """
    scenario = msgspec.structs.replace(
        in_lockstep(scenario),
        seed=0,
        programs={part: _with_content(name) for part, name in scenario.programs.items()},
    )
    canonical = msgspec.json.encode(scenario, enc_hook=_content, order="sorted")
    return hashlib.sha256(canonical).hexdigest()


def _content(value: Any) -> str:
    if not isinstance(value, Path):
        raise NotImplementedError(f"no way to write {type(value).__name__} as JSON")
    if isinstance(value, Output):
        return str(value)
    return hashlib.sha256(read_bytes(value)).hexdigest()


def _with_content(program: str) -> str:
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
    """Return the SHA-256 of the code that a result depends on.

    It covers the source of every installed package of mecazen, and the versions of Python and
    `LIBRARIES`: changed code never shows old results.
    """
    digest = hashlib.sha256()
    for line in (platform.python_version(), *(f"{name} {version_of(name)}" for name in LIBRARIES)):
        digest.update(f"{line}\n".encode())
    packages = {module.name for module in pkgutil.iter_modules() if module.ispkg}
    for package in sorted(name for name in packages if name.startswith("mecazen")):
        spec = importlib.util.find_spec(package)
        assert spec is not None
        for folder in spec.submodule_search_locations or ():
            for file in sorted(Path(folder).rglob("*.py")):
                name = file.relative_to(folder).as_posix()
                digest.update(f"{package}/{name}\n{_content(file)}\n".encode())
    return digest.hexdigest()


def check_version(job: Job) -> None:
    """Raise MecazenError if this process would not run the code that the key names."""
    if job.key.version != version():
        raise MecazenError("this worker has other versions of mecazen or of its libraries")
