"""The whole loop in one process and as processes over Zenoh, and the parts of a tick."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from statistics import median
from typing import Any

import numpy as np
from mecazen import keys
from mecazen.config import Scenario
from mecazen.files import to_value
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import StepRequest
from mecazen.programs import classes
from mecazen_tools.simulate import simulate
from mecazen_tools.simulation import Simulation

from mecazen_bench.harness import Figure, Goal, Group
from mecazen_bench.stack import SCENARIOS, paused, running, spent_s

DURATION_S = 10.0
GROUPS: dict[str, tuple[tuple[str, ...], ...]] = {
    "distributed": (),
    "physics, controller, target; follower": (("physics", "controller", "target"),),
    "physics, target; controller, follower": (("physics", "target"), ("controller", "follower")),
    "physics; all others": (("controller", "target", "follower"),),
    "physics, controller; target; follower": (("physics", "controller"),),
}
"""The services that share a process, by the name of the grouping; other services run separately."""
BLOCKS, BLOCK_TICKS = 10, 100
KINDS = ("pose", "body", "legs", "fused")

REAL_TIMES: Goal = (25.0, None)
DISTRIBUTED: Goal = (0.35, None)
"""Speed relative to one process, with each service in a separate process."""
GROUPED: Goal = (0.6, None)
SHARE: Goal = (None, 10.0)
OF_POSE: Goal = (0.8, None)
UNBOUNDED = ("physics", "follower")
"""Parts whose share has no target: their computation is the purpose of the loop."""
ENDLESS = ("sim.duration_s=36000.0",)
"""No run ends within the measurement."""
Way = tuple[Callable[[int], object], Callable[[], float]]
"""A function that executes a number of ticks, and a function that returns the processor time so far
[s]."""


def run(blocks: int = BLOCKS, duration_s: float = DURATION_S) -> list[Group]:
    """Run the scenario `back` in one and several processes, and profile the nodes of a tick."""
    return [_ways(blocks), _parts("back", {"sim.duration_s": duration_s})]


def run_senses(duration_s: float = DURATION_S) -> list[Group]:
    """Run the scenario `back` with each kind of sensor, and profile a tick of the costliest."""
    factors = {}
    for kind in KINDS:
        settings = {"sim.duration_s": duration_s, "sensor.kind": kind}
        scenario = load_scenario(SCENARIOS / "back.toml", settings)
        factors[kind] = simulate(scenario, "back")[0].rtf
    rows = {
        kind: {
            "× real time": Figure(factor, "more"),
            "of pose": Figure(factor / factors["pose"], "more" if kind == "pose" else OF_POSE),
        }
        for kind, factor in factors.items()
    }
    how = f"in one process; {duration_s:g} s"
    fused = _parts("back", {"sim.duration_s": duration_s, "sensor.kind": "fused"}, ", sensor fused")
    return [Group("Kinds of sensor: scenario back", how, rows), fused]


def run_safety(duration_s: float = DURATION_S) -> list[Group]:
    """Profile a tick of the scenario `crowd` beside the person, with guard and planner."""
    settings = {
        "follower.view": "side_left",
        "follower.planner": {},
        "sim.duration_s": duration_s,
    }
    return [_parts("crowd", settings, ", with planner")]


def _ways(blocks: int) -> Group:
    """Execute blocks of ticks in one process and in several, in turns, and compare them."""
    scenario = load_scenario(SCENARIOS / "back.toml", parse_settings(ENDLESS))
    wall_s: dict[str, list[float]] = {}
    spent: dict[str, list[float]] = {}
    with ExitStack() as exits:
        ways = {"in one process": exits.enter_context(_in_one_process(scenario))}
        for name, groups in GROUPS.items():
            ways[name] = exits.enter_context(_in_processes(groups))
        for block in range(1 + blocks):
            for name, (step, spent_so_far_s) in ways.items():
                begin, before_s = time.perf_counter(), spent_so_far_s()
                step(BLOCK_TICKS)
                if block:  # the first block warms up
                    wall_s.setdefault(name, []).append(time.perf_counter() - begin)
                    spent.setdefault(name, []).append(spent_so_far_s() - before_s)
    rows = {}
    for name, own in spent.items():
        is_one = name == "in one process"
        ratios = [one / other for one, other in zip(spent["in one process"], own, strict=True)]
        goal: Goal = 1.0 if is_one else GROUPED if GROUPS[name] else DISTRIBUTED
        factor = BLOCK_TICKS * scenario.sim.tick_s / median(wall_s[name])
        rows[name] = {
            "× real time": Figure(factor, REAL_TIMES if is_one else "more"),
            "µs/tick": Figure(1e6 * median(own) / BLOCK_TICKS, "less"),
            "of one process": Figure(median(ratios), goal),
        }
    how = (
        f"lockstep without observers, medians of {blocks} blocks of {BLOCK_TICKS} ticks in turns; "
        "µs/tick and their ratio, in pairs: processor time of all processes, which share one core; "
        "services of a process are joined by commas"
    )
    return Group("Whole loop: scenario back", how, rows)


@contextmanager
def _in_one_process(scenario: Scenario) -> Iterator[Way]:
    with Simulation(scenario) as sim:
        yield lambda ticks: sim.run(ticks * scenario.sim.tick_s), time.thread_time


@contextmanager
def _in_processes(groups: tuple[tuple[str, ...], ...]) -> Iterator[Way]:
    grouped = (f"processes={to_value(groups)}",) if groups else ()
    with ExitStack() as exits:
        stack = exits.enter_context(running("back", 'sim.mode="lockstep"', *ENDLESS, *grouped))
        bus = exits.enter_context(paused(stack))
        processes = stack.processes().values()
        yield (
            lambda ticks: bus.call(keys.SIM_STEP, StepRequest(ticks=ticks)),
            lambda: sum(map(spent_s, processes)),
        )


def _parts(name: str, settings: Mapping[str, Any], variant: str = "") -> Group:
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
    rows = {
        part: {
            "p99 of a step, ms": Figure(1e3 * float(np.percentile(steps, 99)), "less"),
            **_share(sum(steps) / result.ticks, total, "less" if part in UNBOUNDED else SHARE),
        }
        for part, steps in spent.items()
    }
    rest = total - sum(map(sum, spent.values())) / result.ticks
    rows["messages, clock and trajectory"] = _share(rest, total, SHARE)
    rows["all"] = _share(total, total, "less")
    how = (
        f"in one process; processor time of nodes' steps, means over {scenario.sim.duration_s:g} s"
    )
    return Group(f"Parts of a tick: scenario {name}{variant}", how, rows)


def _share(seconds: float, total_s: float, goal: Goal) -> dict[str, Figure]:
    return {
        "µs/tick": Figure(1e6 * seconds, "less"),
        "% of the tick": Figure(100.0 * seconds / total_s, goal),
    }


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
