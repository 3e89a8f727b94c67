"""One run, from a job to its scores."""

from __future__ import annotations

import gc
import resource
import time

import msgspec
from mecazen.loading import load_scenario
from mecazen_follower.config import FollowerConfig
from mecazen_tools.simulate import simulate

from mecazen_experiments.jobs import Job, Key, check_version
from mecazen_experiments.scores import Scores, score
from mecazen_experiments.table import Table


class Record(msgspec.Struct, frozen=True):
    """What a run gave, and what it took."""

    key: Key
    trajectory_sha256: str
    """As of `mecazen simulate --json`."""
    scores: Scores
    wall_s: float
    """From the loading of the scenario to the last score."""
    peak_rss_mb: float
    """The most memory that the worker has had so far, this run and those before it."""


def run(job: Job) -> Record:
    """Simulate a job and score it.

    Raises:
        MecazenError: The run failed, or this process has another version of the code.
    """
    check_version(job)
    # services and their bus hold each other, and the last run's world of DART, of many megabytes
    gc.collect()
    begin = time.perf_counter()
    scenario = load_scenario(job.scenario, job.settings)
    result, trajectory = simulate(scenario, job.row)
    standoff = scenario.section(FollowerConfig, "follower").standoff
    scores = score(Table.of(trajectory), standoff)
    return Record(
        key=job.key,
        trajectory_sha256=result.trajectory_sha256,
        scores=scores,
        wall_s=time.perf_counter() - begin,
        peak_rss_mb=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6,
    )


def tabulate(job: Job) -> Table:
    """Simulate a job and return every tick of it.

    Raises:
        MecazenError: As of `run`.
    """
    check_version(job)
    _, trajectory = simulate(load_scenario(job.scenario, job.settings), job.row)
    return Table.of(trajectory)
