"""Experiments: runs per minute, and the gain of a second worker."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from mecazen.loading import load_table
from mecazen_experiments.config import Experiment, experiment_path
from mecazen_experiments.jobs import expand
from mecazen_experiments.local import LocalWorkers
from mecazen_experiments.schedule import run_all
from mecazen_experiments.store import Store

from mecazen_bench.figures import Figure, Group, Row, Target

DURATION_S = 85.0
WORKERS = 1, 2
RUNS = 3
"""Of each worker: with fewer, its start would dominate."""
TABLE2_RUNS = 120
TABLE2_MIN = Target(high=3.0)
MEMORY_MB = Target(high=400.0)


def run(duration_s: float = DURATION_S) -> list[Group]:
    """Run one case of Table II by one worker and by two."""
    (series,) = expand(
        load_table(experiment_path("table2"), Experiment).cases[:1],
        range(1, RUNS * sum(WORKERS) + 1),
        (f"sim.duration_s={duration_s}",),
    )
    jobs = list(series.jobs)
    rows = []
    for count in WORKERS:
        todo = [jobs.pop() for _ in range(RUNS * count)]
        with TemporaryDirectory() as folder, closing(Store(Path(folder) / "bench.sqlite")) as store:
            begin = time.perf_counter()
            records = run_all(todo, store, LocalWorkers(count))
            rate = len(todo) / (time.perf_counter() - begin) * 60.0
        peak = max(record.peak_rss_mb for record in records.values())
        figures = {"runs/min": Figure.of(rate, "more"), "MB per worker": Figure.of(peak, MEMORY_MB)}
        if count == max(WORKERS):
            figures[f"{TABLE2_RUNS} runs, min"] = Figure.of(TABLE2_RUNS / rate, TABLE2_MIN)
        rows.append(Row(f"{count} worker" + "s" * (count > 1), figures))
    how = (
        f"back view without optimisation, {duration_s:g} s; {RUNS} runs per worker, with the "
        "workers' start"
    )
    return [Group("Experiments", how, tuple(rows))]
