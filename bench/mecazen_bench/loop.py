"""The whole loop in one process and as processes over Zenoh, and the parts of a tick."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np
from mecazen.loading import load_scenario
from mecazen.programs import classes
from mecazen_tools.simulate import simulate, simulate_distributed

from mecazen_bench.harness import Figure, Goal, Group
from mecazen_bench.physics import peer_rtf
from mecazen_bench.stack import SCENARIOS

DURATION_S = 10.0
GROUPS: dict[str, tuple[tuple[str, ...], ...]] = {
    "distributed": (),
    "physics; all others": (("controller", "target", "follower"),),
    "physics, controller; all others": (("physics", "controller"), ("target", "follower")),
    "physics, controller; target; follower": (("physics", "controller"),),
    "physics; controller, follower; target": (("controller", "follower"),),
}
"""The services that share a process, by the name of the grouping; others have their own."""
KINDS = ("pose", "body", "legs", "fused")

REAL_TIMES: Goal = (25.0, None)
OF_MUJOCO: Goal = (1.0, None)
DISTRIBUTED: Goal = (0.35, None)
"""Share of the speed of one process, with each service in its own."""
GROUPED: Goal = (0.6, None)
SHARE: Goal = (None, 10.0)
OF_POSE: Goal = (0.8, None)
UNBOUNDED = ("physics", "follower")
"""Parts whose share has no target: their computation is the purpose of the loop."""


def run(duration_s: float = DURATION_S) -> list[Group]:
    """Run the scenario `back` in each way, and divide a tick into its parts."""
    settings = (f"sim.duration_s={duration_s}",)
    return [_ways(settings), _parts("back", settings)]


def run_senses(duration_s: float = DURATION_S) -> list[Group]:
    """Run the scenario `back` with each kind of sensor, and divide a tick of the costliest."""
    settings = (f"sim.duration_s={duration_s}",)
    factors = {}
    for kind in KINDS:
        scenario = load_scenario(SCENARIOS / "back.toml", (*settings, f"sensor.kind={kind}"))
        factors[kind] = simulate(scenario, "back")[0].rtf
    rows = {
        kind: {
            "× real time": Figure(factor, "more"),
            "of pose": Figure(factor / factors["pose"], "more" if kind == "pose" else OF_POSE),
        }
        for kind, factor in factors.items()
    }
    how = f"in one process; {duration_s:g} s"
    fused = _parts("back", (*settings, "sensor.kind=fused"), ", sensor fused")
    return [Group("Kinds of sensor: scenario back", how, rows), fused]


def run_safety(duration_s: float = DURATION_S) -> list[Group]:
    """Divide a tick of the scenario `crowd` beside the person, with guard and planner."""
    settings = ("follower.view='side_left'", "follower.planner={}", f"sim.duration_s={duration_s}")
    return [_parts("crowd", settings, ", with planner")]


def _ways(settings: tuple[str, ...]) -> Group:
    path = SCENARIOS / "back.toml"
    peer = peer_rtf()
    one = simulate(load_scenario(path, settings), "back")[0].rtf
    factors = {"in one process": one}
    goals: dict[str, Goal] = {"in one process": 1.0}
    for name, groups in GROUPS.items():
        grouped = (*settings, f"processes={json.dumps(groups)}") if groups else settings
        factors[name] = simulate_distributed(path, grouped, "back")[0].rtf
        goals[name] = GROUPED if groups else DISTRIBUTED
    rows = {}
    for name, factor in factors.items():
        is_one = name == "in one process"
        rows[name] = {
            "× real time": Figure(factor, REAL_TIMES if is_one else "more"),
            "of one process": Figure(factor / one, goals[name]),
        }
        if peer is not None:
            rows[name]["of MuJoCo"] = Figure(factor / peer, OF_MUJOCO if is_one else "more")
    how = (
        "lockstep, without the start, no observer but the trajectory; MuJoCo: its physics alone, "
        "of the robot with capsules at 1 ms; services of a process are joined by commas"
    )
    return Group("Whole loop: scenario back", how, rows)


def _parts(name: str, settings: tuple[str, ...], variant: str = "") -> Group:
    """Divide a tick of a scenario into the steps of its nodes."""
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
    """Give the processor time of each call of a class's method [s]."""
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
