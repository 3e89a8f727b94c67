"""What the bench measures, and how its parts take turns."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

from mecazen_bench import (
    containers,
    experiments,
    flood,
    latency,
    loop,
    malformed,
    physics,
    realtime,
    recorder,
    robots,
    viewer,
)
from mecazen_bench.figures import Group, merged
from mecazen_bench.machine import Machine, Others
from mecazen_bench.results import SCHEMA, Results

ROUNDS = 5


class Part(NamedTuple):
    """Something that is measured by itself."""

    measure: Callable[[], list[Group]]
    """One round."""
    rounds: int = ROUNDS
    on_demand: bool = False
    """Whether it is measured only where it is asked for: it takes minutes."""


PARTS = {
    "physics": Part(physics.run),
    "robots": Part(robots.run),
    "loop": Part(loop.run),
    "latency": Part(latency.run),
    "realtime": Part(realtime.run, rounds=3),
    "recorder": Part(recorder.run),
    "viewer": Part(viewer.run),
    "peers": Part(physics.run_peers, on_demand=True),
    "experiments": Part(experiments.run, rounds=2, on_demand=True),
    "flood": Part(flood.run, on_demand=True),
    "malformed": Part(malformed.run, rounds=1, on_demand=True),
    "containers": Part(containers.run, on_demand=True),
}


def measure(parts: dict[str, Part], tell: Callable[[str], None]) -> Results:
    """Measure parts in turns, round by round: what else the machine does meets all alike.

    Args:
        parts: What to measure, by name.
        tell: Is told what is measured next.
    """
    others = Others()
    found: dict[str, list[Sequence[Group]]] = {name: [] for name in parts}
    seconds = dict.fromkeys(parts, 0.0)
    for number in range(max(part.rounds for part in parts.values())):
        for name, part in parts.items():
            if number >= part.rounds:
                continue
            tell(f"{name}, round {number + 1} of {part.rounds}")
            begin = time.monotonic()
            found[name].append(part.measure())
            seconds[name] += time.monotonic() - begin
            others.look()
    groups = [group for rounds in found.values() for group in merged(rounds)]
    return Results(SCHEMA, Machine.here(), others.work(), seconds, tuple(groups))
