"""Experiments: runs per minute, the gain of a second worker, and what Dask's scheduler costs."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from distributed import LocalCluster
from mecazen.loading import load_scenario, load_table
from mecazen_experiments.cluster import ClusterWorkers
from mecazen_experiments.config import Experiment, experiment_path
from mecazen_experiments.jobs import Job, expand
from mecazen_experiments.local import LocalWorkers
from mecazen_experiments.schedule import Workers, run_all
from mecazen_experiments.scores import score
from mecazen_experiments.store import Store
from mecazen_experiments.table import Table
from mecazen_tools.simulate import InProcess, result

from mecazen_bench.figures import Figure, Group, Row, Target
from mecazen_bench.loop import BUS, Stopwatch

DURATION_S = 85.0
WORKERS = 1, 2
RUNS = 3
"""Of each worker: with fewer, its start would dominate."""
TABLE2_RUNS = 120
TABLE2_MIN = Target(high=3.0)
MEMORY_MB = Target(high=400.0)


NOTHINGS = 1000
"""Jobs that do nothing, which take the time that the scheduler needs."""
MANY = 100
EFFICIENCY = Target(low=0.9)


def run(duration_s: float = DURATION_S) -> list[Group]:
    """Run one case of Table II by one worker and by two, of this machine and of Dask."""
    (series,) = expand(
        load_table(experiment_path("table2"), Experiment).cases[:1],
        range(1, 2 * RUNS * sum(WORKERS) + 2),
        (f"sim.duration_s={duration_s}",),
    )
    jobs = list(series.jobs)
    rows = []
    rates = {}
    for count in WORKERS:
        todo = [jobs.pop() for _ in range(RUNS * count)]
        rate, peak_mb = _rate(todo, LocalWorkers(count))
        figures = {
            "runs/min": Figure.of(rate, "more"),
            "MB per worker": Figure.of(peak_mb, MEMORY_MB),
        }
        if count == max(WORKERS):
            figures[f"{TABLE2_RUNS} runs, min"] = Figure.of(TABLE2_RUNS / rate, TABLE2_MIN)
        rows.append(Row(_name(count), figures))
    for count in WORKERS:
        todo = [jobs.pop() for _ in range(RUNS * count)]
        with _cluster(count) as workers:
            begin = time.perf_counter()
            for _ in workers.do(_do_nothing, todo * (NOTHINGS // len(todo))):
                pass
            overhead_s = (time.perf_counter() - begin) / NOTHINGS
            rates[count], peak_mb = _rate(todo, workers)
        one_min = 1.0 / rates[min(WORKERS)]
        figures = {
            "runs/min": Figure.of(rates[count], "more"),
            "MB per worker": Figure.of(peak_mb, MEMORY_MB),
            "efficiency": Figure.of(rates[count] * one_min / count, EFFICIENCY),
            "scheduler ms/run": Figure.of(overhead_s * 1e3, "less"),
        }
        if count == max(WORKERS):
            share = min(1.0, one_min * 60.0 / (MANY * overhead_s))
            figures[f"modelled: {MANY} workers' efficiency"] = Figure.of(share, "more")
        rows.append(Row(f"Dask, {_name(count)}", figures))
    how = (
        f"back view without optimisation, {duration_s:g} s; {RUNS} runs per worker, of this "
        "machine with the workers' start; scheduler: jobs that do nothing; modelled: runs of "
        "that length, handed out one after the other"
    )
    return [Group("Experiments", how, tuple(rows)), _profile(jobs.pop())]


def _profile(job: Job) -> Group:
    """Divide a run, from its job to its scores, into its parts."""
    watch = Stopwatch()
    watch.turn_to("scenario loaded")
    scenario = load_scenario(job.scenario, job.settings)
    watch.turn_to("services made")
    with closing(InProcess(scenario, watch.seen_by)) as loop:
        for _ in loop.ticks():
            watch.turn_to("physics")
    watch.turn_to("trajectory: arrays and hash")
    result(loop.scenario, job.row, loop.trajectory, 1.0)
    watch.turn_to("scores")
    score(Table.of(loop.trajectory), scenario.follower.standoff)
    watch.turn_to(BUS)
    total_ns = sum(watch.ns.values())
    rows = [
        Row(
            part,
            {
                "ms": Figure.of(ns / 1e6, "less"),
                "% of the run": Figure.of(100.0 * ns / total_ns, "less"),
            },
        )
        for part, ns in watch.ns.items()
    ]
    rows.append(Row("all", {"ms": Figure.of(total_ns / 1e6, "less")}))
    how = (
        f"the same case, {scenario.sim.duration_s:g} s, in a process that has made runs before; "
        "with the stopwatch's own time"
    )
    return Group("Parts of a run of Table II", how, tuple(rows))


def _name(workers: int) -> str:
    return f"{workers} worker" + "s" * (workers > 1)


def _rate(jobs: Sequence[Job], workers: Workers) -> tuple[float, float]:
    """Return runs a minute, and the largest peak of a worker's memory [MB]."""
    with TemporaryDirectory() as folder, closing(Store(Path(folder) / "bench.sqlite")) as store:
        begin = time.perf_counter()
        records = run_all(jobs, store, workers)
        rate = len(jobs) / (time.perf_counter() - begin) * 60.0
    return rate, max(record.peak_rss_mb for record in records.values())


@contextmanager
def _cluster(workers: int) -> Iterator[ClusterWorkers]:
    """Start Dask's scheduler, and workers of a core each."""
    with (
        LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=workers,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",  # None is the one known port
        ) as cluster,
        closing(ClusterWorkers(cluster.scheduler_address)) as found,
    ):
        yield found


def _do_nothing(job: Job) -> Job:
    return job
