"""A run: a job simulated, observed and scored. A kind of experiment says by which scores."""

from __future__ import annotations

import gc
import re
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import msgspec
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.keys import SKELETONS, TARGET_SKELETON, Topic
from mecazen.loading import load_scenario
from mecazen.standoff import Standoff
from mecazen_tools.simulate import InProcess, result

from mecazen_experiments.jobs import Job, Key, check_version
from mecazen_experiments.scores import Scores, score
from mecazen_experiments.table import Table

T = TypeVar("T")

Samples = Mapping[str, list[Any]]
"""All messages on topics so far, by the topics' keys."""
Drive = Callable[[int, Samples], Mapping[str, bytes]]
"""Returns payloads in JSON to put in a tick, by key, from its number and what was published."""


class Observed(NamedTuple):
    """A finished run: all ticks, and all samples of some topics."""

    table: Table
    trajectory_sha256: str
    """As in `mecazen simulate --json`."""
    samples: Samples


class Record(msgspec.Struct, Generic[T], frozen=True):
    """The scores of a run, and its cost."""

    key: Key
    trajectory_sha256: str
    scores: T
    wall_s: float
    """From loading the scenario to the last score."""
    peak_rss_mb: float
    """The peak memory of the worker so far, in this run and those before it."""


class Kind(NamedTuple, Generic[T]):
    """A kind of experiment: how a run is measured, and what is made of the scores of several."""

    name: str
    """In the store."""
    record: type[Record[T]]
    measure: Callable[[Job], tuple[T, str]]
    """Simulates a job; returns its scores and the hash of its trajectory."""
    numbers: Callable[[T], Mapping[str, float | None]]
    """Returns the scores by name; None where there is nothing to measure."""
    sums: Sequence[str] = ()
    """Scores that are added over runs; others are averaged."""
    least: Sequence[str] = ()
    """Scores of which the smallest counts."""


def observe(scenario: Scenario, *topics: Topic[Any], drive: Drive = lambda *_: {}) -> Observed:
    """Simulate a scenario, and keep all samples of some topics.

    Args:
        scenario: What to simulate.
        topics: The topics.
        drive: Returns the payloads to put in each tick but the last.

    Raises:
        MecazenError: The run failed.
    """
    with closing(InProcess(scenario)) as run:
        samples = collect(run, *topics, drive=drive)
        found = result(run.scenario, "", run.trajectory, 1.0)
        return Observed(Table.of(run.trajectory), found.trajectory_sha256, samples)


def collect(run: InProcess, *topics: Topic[Any], drive: Drive = lambda *_: {}) -> Samples:
    """Make a whole run, driven as in `observe`; return all samples of some topics."""
    samples: dict[str, list[Any]] = {topic.key: [] for topic in topics}
    for topic in topics:
        run.bus.subscribe(topic, partial(_keep, samples[topic.key]), every=True)
    for tick, _ in enumerate(run.ticks(), start=1):
        for key, payload in drive(tick, samples).items():
            run.bus.put_bytes(key, payload)
    return samples


def _keep(samples: list[Any], message: Any, _: object) -> None:
    samples.append(message)


def observe_bodies(scenario: Scenario, *topics: Topic[Any]) -> Observed:
    """Simulate a scenario that has a body tracker; see `observe`.

    Raises:
        MecazenError: It has none, or the run failed.
    """
    if "tracker" not in scenario.features:
        raise ConfigError("no body tracker: this experiment needs sensor.kind = 'body' or 'fused'")
    return observe(scenario, TARGET_SKELETON, SKELETONS, *topics)


def loaded(job: Job) -> Scenario:
    """Return the scenario of a job.

    Raises:
        ConfigError: It can't be loaded.
    """
    return load_scenario(job.scenario, job.settings)


def record(kind: Kind[T], job: Job) -> Record[T]:
    """Simulate a job and score it.

    Raises:
        MecazenError: The run failed, or this process has another version of the code.
    """
    check_version(job)
    # reference cycles hold the last run's DART world, of many megabytes
    gc.collect()
    begin = time.perf_counter()
    scores, sha256 = kind.measure(job)
    wall_s = time.perf_counter() - begin
    # not getrusage: its maximum includes the memory of the process that started this one
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert found is not None
    return kind.record(job.key, sha256, scores, wall_s, int(found[1]) * 1024 / 1e6)


def standoff_of(scenario: Scenario) -> Standoff:
    """Return the place that the follower is to keep."""
    return scenario.follower.standoff


def _following(job: Job) -> tuple[Scores, str]:
    scenario = loaded(job)
    seen = observe(scenario)
    return score(seen.table, standoff_of(scenario)), seen.trajectory_sha256


def _numbers(scores: Scores) -> Mapping[str, float | None]:
    settled = msgspec.structs.asdict(scores.settled)
    return msgspec.structs.asdict(scores.whole) | {f"settled_{n}": v for n, v in settled.items()}


FOLLOWING = Kind("following", Record[Scores], _following, _numbers)
"""How well the robot follows: distance, angle, smoothness, estimate."""


def tabulate(job: Job) -> Table:
    """Simulate a job and return every tick of it; raises as `observe`."""
    check_version(job)
    return observe(loaded(job)).table
