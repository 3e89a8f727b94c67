"""One run, from a job to its scores."""

from __future__ import annotations

import gc
import re
import time
from pathlib import Path

import msgspec
from mecazen.config import Scenario
from mecazen.loading import load_scenario
from mecazen_tools.simulate import Result, simulate
from mecazen_tools.trajectory import Trajectory

from mecazen_experiments.jobs import Job, Key, check_version
from mecazen_experiments.scores import Scores, score
from mecazen_experiments.table import Table


class Record(msgspec.Struct, frozen=True):
    """The results of a run, and its cost."""

    key: Key
    trajectory_sha256: str
    """As of `mecazen simulate --json`."""
    scores: Scores
    wall_s: float
    """From loading the scenario to the last score."""
    peak_rss_mb: float
    """The peak memory of the worker so far, in this run and those before it."""


def simulated(job: Job) -> tuple[Scenario, Result, Trajectory]:
    """Simulate a job.

    Raises:
        MecazenError: The run failed, or this process has another version of the code.
    """
    check_version(job)
    scenario = load_scenario(job.scenario, job.settings)
    return scenario, *simulate(scenario, job.row)


def run(job: Job) -> Record:
    """Simulate a job and score it; raises as `simulated`."""
    # reference cycles hold the last run's DART world, of many megabytes
    gc.collect()
    begin = time.perf_counter()
    scenario, result, trajectory = simulated(job)
    standoff = scenario.follower.standoff
    scores = score(Table.of(trajectory), standoff)
    wall_s = time.perf_counter() - begin
    # not getrusage: its maximum includes the memory of the process that started this one
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert found is not None
    return Record(job.key, result.trajectory_sha256, scores, wall_s, int(found[1]) * 1024 / 1e6)


def tabulate(job: Job) -> Table:
    """Simulate a job and return every tick of it; raises as `simulated`."""
    return Table.of(simulated(job)[2])
