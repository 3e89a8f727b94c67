"""Followers compared in one scenario with the same seeds, and their differences seed by seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from mecazen.errors import ConfigError, MecazenError
from mecazen.loading import load_scenario, parse_settings
from mecazen.programs import find

from mecazen_tools.pool import CORES, processes
from mecazen_tools.simulate import Progress, simulate
from mecazen_tools.statistics import Interval, mean_interval, paired_difference
from mecazen_tools.table import Floats, Table, deviations

DEFAULT = "default"
"""Name of the follower that the scenario has without other settings."""

POLICY = "policy:"
"""Prefix of the file of a trained policy's weights: docs/gym.md."""


class FollowerRun(NamedTuple):
    """A run of a follower: its measures, its errors, and for the first seed all ticks."""

    measures: dict[str, float]
    """The measures of `MEASURES`, as far as there are."""
    errors: Floats
    """Errors of the distance [m] and of the heading [rad] tick by tick (2, n)."""
    table: Table | None


Runs = Mapping[str, Mapping[int, FollowerRun]]
"""Runs by the names of the followers, and by seed."""

MEASURES = {"D_err [m]": 4, "Θ_err [°]": 2, "lost [%]": 1, "contacts": 1}
"""The measures with their digits."""


class Comparison(msgspec.Struct, frozen=True):
    """The output of `mecazen compare --json`."""

    scenario: str
    seeds: tuple[int, ...]
    means: dict[str, dict[str, Interval]]
    """Measures by follower."""
    reference: str
    """The follower that the others are compared with."""
    differences: dict[str, dict[str, Interval]]
    """Measures minus those of the reference, in pairs of runs with the same seed."""


def candidates(path: Path, followers: Sequence[str], overrides: Sequence[str]) -> dict[str, Any]:
    """Return the settings of each follower in a scenario, by its short name.

    Args:
        path: The scenario's file.
        followers: Each is `default`, a program such as `my_follower.py:MyFollower`, a trained
            policy `policy:weights.npz`, or settings `key=value`, separated by spaces.
        overrides: Settings of all of them.

    Raises:
        ConfigError: A follower can't be used, or the scenario has no person, or several robots.
    """
    names = [follower.rpartition(":")[2] for follower in followers]
    if len({*names}) < len(names):
        names = [*followers]
    if len({*names}) < max(len(names), 2):
        example = f"my_follower.py:MyFollower {DEFAULT}"
        raise ConfigError(f"followers: two or more that differ, such as {example}")
    settings = {}
    for name, follower in zip(names, followers, strict=True):
        if follower == DEFAULT:
            texts = []
        elif "=" in follower:
            texts = follower.split()
        elif follower.startswith(POLICY):
            texts = [
                "programs.follower=mecazen_gym.policy:PolicyFollower",
                f"follower.policy={follower.removeprefix(POLICY)}",
            ]
        else:
            texts = [f"programs.follower={follower}"]
        settings[name] = parse_settings([*overrides, *texts])
        scenario = load_scenario(path, settings[name])
        if scenario.robots:
            raise ConfigError(f"{path.stem}: compare takes a scenario of one robot")
        if missing := {"follower", "target"} - {*scenario.services}:
            raise ConfigError(f"{path.stem}: nothing to compare without the service {min(missing)}")
        find("follower", scenario.programs)
    return settings


def run_all(path: Path, settings: Mapping[str, Any], seeds: Sequence[int], done: Progress) -> Runs:
    """Simulate each follower with each seed, in a process for each core; sorted by seed.

    Raises:
        MecazenError: A run failed; the message names follower and seed.
    """
    runs: dict[str, dict[int, FollowerRun]] = {name: {} for name in settings}
    with processes(min(CORES, len(settings) * len(seeds))) as pool:
        futures = {
            pool.submit(_run, path, {**values, "seed": seed}, keep=seed == seeds[0]): (name, seed)
            for seed in seeds
            for name, values in settings.items()
        }
        for number, future in enumerate(as_completed(futures), 1):
            name, seed = futures[future]
            try:
                runs[name][seed] = future.result()
            except (MecazenError, BrokenProcessPool) as error:
                raise MecazenError(f"{name}, seed {seed}: {error}") from None
            done(number)
    return {name: dict(sorted(by_seed.items())) for name, by_seed in runs.items()}


def _run(path: Path, settings: Mapping[str, Any], *, keep: bool) -> FollowerRun:
    scenario = load_scenario(path, settings)
    _, trajectory = simulate(scenario, path.stem)
    table, scores, contacts = trajectory.table(), trajectory.scores(), trajectory.contacts()
    values = (
        scores.d_err_m,
        scores.theta_err_deg,
        100.0 * sum(scores.lost.values()) if (table.tracking != "").any() else None,
        float(contacts.persons + contacts.obstacles),
    )
    measures = {name: x for name, x in zip(MEASURES, values, strict=True) if x is not None}
    distance, _, heading = deviations(table, scenario.follower.standoff)
    return FollowerRun(measures, np.array([distance, heading]), table if keep else None)


def compare(scenario: str, runs: Runs) -> Comparison:
    """Return means and paired differences; the last follower is the reference."""
    *names, reference = runs
    values = {name: {key: _by_seed(runs[name], key) for key in MEASURES} for name in runs}
    means = {
        name: {key: mean_interval([*seeds.values()]) for key, seeds in measures.items() if seeds}
        for name, measures in values.items()
    }
    differences = {
        name: {
            key: paired_difference(values[reference][key], values[name][key])
            for key in means[name]
            if key in means[reference]
        }
        for name in names
    }
    return Comparison(scenario, tuple(runs[reference]), means, reference, differences)


def _by_seed(runs: Mapping[int, FollowerRun], key: str) -> dict[int, float]:
    return {seed: run.measures[key] for seed, run in runs.items() if key in run.measures}
