"""The whole loop in one process and as processes over Zenoh, and the parts of a tick."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from statistics import median
from typing import Any

import numpy as np
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.files import to_value
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import Empty, StepRequest
from mecazen.programs import classes
from mecazen.robots import join_key
from mecazen_tools.simulate import simulate
from mecazen_tools.simulation import Simulation

from mecazen_bench.harness import Row, Tables
from mecazen_bench.processes import HELPERS, SCENARIOS, running, spent_s, spin_until

DURATION_S = 10.0
ONE = "in one process"
GROUPS = {
    "distributed": (),
    "physics, controller, target; follower": (("physics", "controller", "target"),),
}
"""The services that share a process, by the name of the grouping; other services run separately."""
PARTS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "back": ("back", {}),
    "back, sensor fused": ("back", {"sensor.kind": "fused"}),
    "crowd, with planner": ("crowd", {"follower.view": "side_left", "follower.planner": {}}),
}
"""Scenario and settings of the ticks that are divided among their nodes, by name."""
BLOCKS, BLOCK_TICKS = 10, 100

ENDLESS = "sim.duration_s=36000.0"
"""Setting with which no run ends within the measurement."""

Way = tuple[Callable[[int], object], Callable[[], float]]
"""A function that executes a number of ticks, and a function that returns the processor time so far
[s]."""


def run(blocks: int = BLOCKS, duration_s: float = DURATION_S) -> Tables:
    """Run `back` in one and several processes, and divide ticks among their nodes."""
    return {
        "Whole loop: scenario back": _ways(blocks),
        **{
            f"Parts of a tick: scenario {title}": _parts(
                name, {**settings, "sim.duration_s": duration_s}
            )
            for title, (name, settings) in PARTS.items()
        },
    }


def _ways(blocks: int) -> dict[str, Row]:
    """Execute blocks of ticks in one process and in several, in turns, and compare them."""
    scenario = load_scenario(SCENARIOS / "back.toml", parse_settings([ENDLESS]))
    wall_s: dict[str, list[float]] = {}
    spent: dict[str, list[float]] = {}
    with ExitStack() as exits:
        sim = exits.enter_context(Simulation(scenario))
        ways: dict[str, Way] = {
            ONE: (lambda ticks: sim.run(ticks * scenario.sim.tick_s), time.thread_time)
        }
        for name, groups in GROUPS.items():
            ways[name] = exits.enter_context(_in_processes(groups))
        for block in range(1 + blocks):
            for name, (step, spent_so_far_s) in ways.items():
                begin, before_s = time.perf_counter(), spent_so_far_s()
                step(BLOCK_TICKS)
                if block:  # the first block warms up
                    wall_s.setdefault(name, []).append(time.perf_counter() - begin)
                    spent.setdefault(name, []).append(spent_so_far_s() - before_s)
    return {
        name: {
            "× real time": (BLOCK_TICKS * scenario.sim.tick_s / median(wall_s[name]), "more"),
            "µs/tick": (1e6 * median(seconds) / BLOCK_TICKS, "less"),
            "of one process": (
                median(a / b for a, b in zip(spent[ONE], seconds, strict=True)),
                "more",
            ),
        }
        for name, seconds in spent.items()
    }


@contextmanager
def _in_processes(groups: tuple[tuple[str, ...], ...]) -> Iterator[Way]:
    grouped = (f"processes={to_value(groups)}",) if groups else ()
    with (
        running("back", 'sim.mode="lockstep"', ENDLESS, *grouped) as stack,
        closing(ZenohBus(stack.scenario.bus)) as bus,
    ):
        ready = {join_key(f"{service}/ready", robot) for service, robot in stack.scenario.parts}
        spin_until(bus, lambda: bus.alive() >= ready, "the services do not start")
        bus.call(keys.SIM_PAUSE, Empty())
        processes = [p for name, p in stack.processes().items() if name not in HELPERS]
        yield (
            lambda ticks: bus.call(keys.SIM_STEP, StepRequest(ticks=ticks)),
            lambda: sum(map(spent_s, processes)),
        )


def _parts(name: str, settings: Mapping[str, Any]) -> dict[str, Row]:
    """Measure the steps of each node in a tick of a scenario."""
    scenario = load_scenario(SCENARIOS / f"{name}.toml", settings)
    with ExitStack() as stack:
        spent = {
            f"{service}: {node}" if node != service else node: stack.enter_context(
                timed(kind, "step")
            )
            for service in scenario.services
            for node, kind in classes(service, scenario).items()
        }
        result, _ = simulate(scenario, name)
    total = result.wall_s / result.ticks

    def share(seconds: float) -> Row:
        return {
            "µs/tick": (1e6 * seconds, "less"),
            "% of the tick": (100.0 * seconds / total, "less"),
        }

    rows = {
        part: {
            "p99 of a step, ms": (1e3 * float(np.percentile(steps, 99)), "less"),
            **share(sum(steps) / result.ticks),
        }
        for part, steps in spent.items()
    }
    remainder = total - sum(map(sum, spent.values())) / result.ticks
    rows["messages, clock and trajectory"] = share(remainder)
    rows["all"] = share(total)
    return rows


@contextmanager
def timed(owner: type, name: str) -> Iterator[list[float]]:
    """Record the processor time of each call of a class's method [s], within the context."""
    method = getattr(owner, name)
    took: list[float] = []

    def measured(*arguments: Any) -> Any:
        begin = time.thread_time_ns()
        result = method(*arguments)
        took.append((time.thread_time_ns() - begin) / 1e9)
        return result

    setattr(owner, name, measured)
    try:
        yield took
    finally:
        setattr(owner, name, method)
