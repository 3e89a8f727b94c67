"""Experiments: runs per minute, the gain of a second worker, and the cost of Dask's scheduler."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from tempfile import TemporaryDirectory

from distributed import LocalCluster
from mecazen.loading import load_table
from mecazen_experiments.config import Experiment, chosen, experiment_path
from mecazen_experiments.executor import (
    Workers,
    cluster_workers,
    do_all,
    local_workers,
    run_all,
)
from mecazen_experiments.following import FOLLOWING
from mecazen_experiments.jobs import Job, expand
from mecazen_experiments.store import Store

from mecazen_bench.harness import Figure, Goal, Group

DURATION_S = 85.0
WORKERS = 1, 2
RUNS = 3
"""Number of runs per worker: with fewer, the start of the worker would dominate."""
MEMORY_MB: Goal = (None, 400.0)
EFFICIENCY: Goal = (0.9, None)
NOTHINGS = 1000
"""Number of empty jobs, which take only the time of the scheduler."""


def run(duration_s: float = DURATION_S) -> list[Group]:
    """Run one case of Table II with one and with two workers, of this machine and of Dask."""
    experiment = chosen(load_table(experiment_path("table2"), Experiment), ["case=back without"])
    seeds = range(1, 2 * RUNS * sum(WORKERS) + 1)
    (series,) = expand(experiment, seeds, (f"sim.duration_s={duration_s}",))
    jobs = list(series.jobs)
    rows: dict[str, dict[str, Figure]] = {}
    for name in ("", "Dask, "):
        rates: list[float] = []
        for count in WORKERS:
            todo = [jobs.pop() for _ in range(RUNS * count)]
            with ExitStack() as stack:
                workers = _cluster(count, stack) if name else local_workers(count)
                figures = rows.setdefault(f"{name}{count} worker{'s' * (count > 1)}", {})
                if name:
                    figures["scheduler ms/run"] = Figure(_overhead_ms(workers, todo), "less")
                rate, peak_mb = _rate(todo, workers)
            rates.append(rate)
            figures["runs/min"] = Figure(rate, "more")
            figures["MB per worker"] = Figure(peak_mb, MEMORY_MB)
            figures["efficiency"] = Figure(rate / rates[0] / count, EFFICIENCY)
    how = (
        f"back view without optimisation, {duration_s:g} s; {RUNS} runs per worker, of this "
        "machine with the workers' start; scheduler: jobs that do nothing"
    )
    return [Group("Experiments", how, rows)]


def _rate(jobs: Sequence[Job], workers: Workers) -> tuple[float, float]:
    """Return runs per minute, and the largest peak of a worker's memory [MB]."""
    with TemporaryDirectory() as folder, closing(Store(Path(folder) / "bench.sqlite")) as store:
        begin = time.perf_counter()
        records = run_all(FOLLOWING, jobs, store, workers)
        rate = len(jobs) / (time.perf_counter() - begin) * 60.0
    return rate, max(record.peak_rss_mb for record in records.values())


def _overhead_ms(workers: Workers, jobs: Sequence[Job]) -> float:
    begin = time.perf_counter()
    for _ in do_all(_do_nothing, [*jobs] * (NOTHINGS // len(jobs)), workers):
        pass
    return 1e3 * (time.perf_counter() - begin) / NOTHINGS


def _cluster(workers: int, stack: ExitStack) -> Workers:
    """Start Dask's scheduler, and workers with one core each."""
    cluster = LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=workers,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",  # None would use a fixed port
    )
    stack.enter_context(cluster)
    return stack.enter_context(cluster_workers(cluster.scheduler_address))


def _do_nothing(job: Job) -> Job:
    return job
