"""The benchmarks, and how they are interleaved."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from mecazen.errors import MecazenError

from mecazen_bench import (
    experiments,
    flood,
    intruder,
    latency,
    loop,
    malformed,
    physics,
    realtime,
    recorder,
    robots,
    ros2,
    ros2_loop,
    safety,
    senses,
    steps,
)
from mecazen_bench.figures import Group, merged
from mecazen_bench.machine import Machine, Others
from mecazen_bench.results import SCHEMA, Measured, Results


class Benchmark(NamedTuple):
    """Something that is measured by itself."""

    measure: Callable[[], list[Group]]
    """One round."""
    rounds: int = 5
    on_demand: bool = False
    """Whether it is measured only on request: it takes minutes."""


def _malformed(
    payloads: int = malformed.PAYLOADS,
    over_zenoh: int = intruder.PAYLOADS,
    minutes: float = math.inf,
) -> list[Group]:
    """Fuzz services in this process, an open and a secured stack, each for so long at most."""
    in_process = malformed.run(payloads, minutes=minutes)
    return [*in_process, intruder.run(over_zenoh, minutes=minutes)]


def _ros2() -> list[Group]:
    return [*ros2.run(), *ros2_loop.run()]


BENCHMARKS = {
    "physics": Benchmark(physics.run),
    "robots": Benchmark(robots.run),
    "loop": Benchmark(loop.run),
    "senses": Benchmark(senses.run, rounds=3),
    "safety": Benchmark(safety.run, rounds=3),
    "latency": Benchmark(latency.run),
    "realtime": Benchmark(realtime.run, rounds=3),
    "recorder": Benchmark(recorder.run),
    "ros2": Benchmark(_ros2, rounds=3),
    "viewer": Benchmark(realtime.run_viewer),
    "peers": Benchmark(physics.run_peers, on_demand=True),
    "steps": Benchmark(steps.run, rounds=1, on_demand=True),
    "experiments": Benchmark(experiments.run, rounds=2, on_demand=True),
    "flood": Benchmark(flood.run, on_demand=True),
    "malformed": Benchmark(_malformed, rounds=1, on_demand=True),
    "containers": Benchmark(latency.run_containers, on_demand=True),
}


def select(
    only: Sequence[str],
    benchmarks: dict[str, Benchmark] = BENCHMARKS,
    payloads: int | None = None,
    minutes: float = math.inf,
) -> dict[str, Benchmark]:
    """Return the benchmarks named, or all that are not on demand; malformed with its budget.

    Raises:
        MecazenError: There is no such benchmark.
    """
    for name in only:
        if name not in benchmarks:
            raise MecazenError(
                f"--only {name}: no such benchmark; there are {', '.join(benchmarks)}"
            )
    if payloads is not None or minutes < math.inf:
        if "malformed" not in only:
            raise MecazenError("--payloads and --minutes go with --only malformed")
        fuzz = partial(_malformed, minutes=minutes)
        if payloads is not None:
            fuzz = partial(fuzz, payloads=payloads, over_zenoh=payloads)
        benchmarks = benchmarks | {"malformed": benchmarks["malformed"]._replace(measure=fuzz)}
    return {
        name: benchmark
        for name, benchmark in benchmarks.items()
        if (name in only if only else not benchmark.on_demand)
    }


def measure(benchmarks: dict[str, Benchmark], report: Callable[[str], None]) -> Results:
    """Measure benchmarks, interleaved, so that the load of others affects all alike.

    `report` is called with what is measured next.
    """
    others = Others()
    found: dict[str, list[Sequence[Group]]] = {name: [] for name in benchmarks}
    seconds = dict.fromkeys(benchmarks, 0.0)
    for number in range(max(benchmark.rounds for benchmark in benchmarks.values())):
        for name, benchmark in benchmarks.items():
            if number < benchmark.rounds:
                report(f"{name}, round {number + 1} of {benchmark.rounds}")
                begin = time.monotonic()
                found[name].append(benchmark.measure())
                seconds[name] += time.monotonic() - begin
    measured = {
        name: Measured(seconds[name], tuple(merged(rounds))) for name, rounds in found.items()
    }
    return Results(SCHEMA, Machine.here(), others.so_far(), measured)
