"""What guard and planner cost: a step, a plan, and both in real time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from mecazen.loading import load_scenario
from mecazen_follower.planner.planner import Planner
from mecazen_guard.node import GuardNode
from mecazen_tools.simulate import simulate

from mecazen_bench.figures import Better, Figure, Group, Row, Target
from mecazen_bench.loop import DURATION_S
from mecazen_bench.stack import CPU, SCENARIOS

NAME = "crowd"
SETTINGS = ("follower.view='side_left'", "follower.planner={}")
Goal = Target | Better
STEP_MS, PLAN_MS, CPU_PERCENT = Target(high=0.3), Target(high=8.0), Target(high=25.0)


def run(duration_s: float = DURATION_S) -> list[Group]:
    """Run the scenario `crowd` with the planner, beside the person."""
    settings = (*SETTINGS, f"sim.duration_s={duration_s}")
    scenario = load_scenario(SCENARIOS / f"{NAME}.toml", settings)
    with (
        _timed(GuardNode, "step") as steps,
        _timed(Planner, "see") as scans,
        _timed(Planner, "command") as commands,
        _timed(Planner, "replan") as plans,
    ):
        simulate(scenario, NAME)
    guard, planner = sum(steps), sum(scans) + sum(commands)

    def share(ms: float) -> Figure:
        return Figure.of(ms / duration_s / 10.0, "less")

    def row(subject: str, ms: list[float], goals: tuple[Goal, Goal], share_ms: float) -> Row:
        figures = {
            title: Figure.of(float(np.percentile(ms, q)), goal)
            for title, q, goal in zip(("median ms", "p99 ms"), (50, 99), goals, strict=True)
        }
        return Row(subject, figures | {CPU: share(share_ms)})

    both = Figure.of(share(guard + planner).value, CPU_PERCENT)
    rows = (
        row("guard: a step", steps, (STEP_MS, "less"), guard),
        row("planner: a plan", plans, ("less", PLAN_MS), planner),
        Row("both", {CPU: both}),
    )
    how = (
        f"in one process; {duration_s:g} s beside the person; processor time, "
        "and its share of simulated time: 100 steps, 20 plans and 10 scans a second"
    )
    return [Group(f"Guard and planner: scenario {NAME}", how, rows)]


@contextmanager
def _timed(owner: type, name: str) -> Iterator[list[float]]:
    """Give the processor time of each call of a class's method [ms]."""
    method = getattr(owner, name)
    took: list[float] = []

    def timed(*arguments: Any) -> Any:
        begin = time.thread_time_ns()
        result = method(*arguments)
        took.append((time.thread_time_ns() - begin) / 1e6)
        return result

    setattr(owner, name, timed)
    try:
        yield took
    finally:
        setattr(owner, name, method)
