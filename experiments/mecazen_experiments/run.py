"""A run: a job simulated, observed and scored by a kind of experiment."""

from __future__ import annotations

import gc
import re
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec
from mecazen.config import Scenario
from mecazen.errors import ConfigError, MecazenError
from mecazen.files import to_value
from mecazen.keys import SKELETONS, TARGET_SKELETON, Topic
from mecazen.loading import load_scenario, parse_settings
from mecazen_tools.simulation import Simulation

from mecazen_experiments.jobs import Job, check_version
from mecazen_experiments.report import Kind, Record
from mecazen_experiments.table import Table

T = TypeVar("T")

Samples = Mapping[str, list[Any]]
"""All messages on topics so far, by the topics' keys."""
Drive = Callable[[int, Samples], Mapping[str, bytes]]
"""Returns the payloads in JSON to publish in a tick, by key, given its number and all samples so
far."""


class Observed(NamedTuple):
    """A finished run: all ticks, and all samples of some topics."""

    table: Table
    trajectory_sha256: str
    """Hash of the trajectory, as in `mecazen simulate --json`."""
    samples: Samples


def observe(scenario: Scenario, *topics: Topic[Any], drive: Drive = lambda *_: {}) -> Observed:
    """Simulate a scenario, and keep all samples of some topics.

    Args:
        scenario: The scenario to simulate.
        topics: The topics.
        drive: Returns the payloads to publish in each tick except the last.
    """
    with Simulation(scenario) as sim:
        samples = collect(sim, *topics, drive=drive)
        sim.trajectory.refuse_incomplete()
        return Observed(Table.of(sim.trajectory), sim.trajectory.sha256(), samples)


def collect(sim: Simulation, *topics: Topic[Any], drive: Drive = lambda *_: {}) -> Samples:
    """Simulate a whole run, driven as in `observe`; return all samples of some topics."""
    samples: dict[str, list[Any]] = {topic.key: [] for topic in topics}
    for topic in topics:
        sim.bus.subscribe(topic, partial(_keep, samples[topic.key]))
    sim.reset()  # with the samples of the first tick
    for tick in range(1, sim.scenario.sim.ticks):
        for key, payload in drive(tick, samples).items():
            sim.bus.put_bytes(key, payload)
        sim.step()
    return samples


def _keep(samples: list[Any], message: Any, _: object) -> None:
    samples.append(message)


def observe_bodies(scenario: Scenario, *topics: Topic[Any]) -> Observed:
    """Simulate a scenario that has a body tracker; see `observe`."""
    if "tracker" not in scenario.features:
        raise ConfigError("no body tracker: this experiment needs sensor.kind = 'body' or 'fused'")
    return observe(scenario, TARGET_SKELETON, SKELETONS, *topics)


def record(kind: Kind[T], job: Job) -> Record[T]:
    """Simulate a job and score it."""
    check_version(job)
    # reference cycles hold the last run's DART world, of many megabytes
    gc.collect()
    begin = time.perf_counter()
    scores, sha256 = kind.measure(job)
    wall_s = time.perf_counter() - begin
    # not getrusage: its maximum includes the memory of the parent process
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert found is not None
    result = kind.record(job.key, sha256, scores, wall_s, int(found[1]) * 1024 / 1e6)
    try:
        # as a later command reads it: NaN and infinity are null in JSON, which is None
        return msgspec.json.decode(msgspec.json.encode(result), type=kind.record)
    except msgspec.ValidationError as error:
        raise MecazenError(f"a score that can't be missing is not finite: {error}") from None


def tabulate(job: Job) -> Table:
    """Simulate a job and return every tick of it; raises as `observe`."""
    check_version(job)
    return observe(job.load()).table


def file_name(job: Job) -> str:
    """Return the name of a job's row as a file name."""
    return re.sub(r"[^\w.=+-]+", "_", job.row.replace(", ", "-"))


def film(job: Job, folder: Path) -> Path:
    """Simulate a job, and record the whole run; return the file. Raises as `observe`."""
    check_version(job)
    file = folder / f"{file_name(job)}.mcap"
    recorded = (
        f"services={to_value([*job.load().services, 'recorder'])}",
        f"recorder.file={to_value(str(file))}",
    )
    observe(load_scenario(job.scenario, parse_settings((*job.settings, *recorded))))
    return file
