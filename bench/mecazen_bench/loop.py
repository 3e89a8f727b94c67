"""The whole loop: in one process, as processes over Zenoh, and its messages alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mecazen.loading import load_scenario
from mecazen.simulate import Result, simulate, simulate_distributed

from mecazen_bench.figures import Better, Figure, Group, Row, Target
from mecazen_bench.scenarios import SCENARIOS

DURATION_S = 10.0
STEPS = ("physics.dt_s=0.001",)
NULL_PHYSICS = Path(__file__).with_name("null_physics.py")

DISTRIBUTED = Target.at_least(700.0)
MESSAGING = Target.at_least(2000.0)


def run(duration_s: float = DURATION_S) -> list[Group]:
    """Run the scenario `back` in each of the three ways."""
    path = SCENARIOS / "back.toml"
    settings = (*STEPS, f"sim.duration_s={duration_s}")
    nothing = (*settings, f'programs.physics="{NULL_PHYSICS}:NullPhysics"')
    ways: dict[str, Callable[[], tuple[Result, object]]] = {
        "in one process": lambda: simulate(load_scenario(path, settings), path.stem),
        "distributed": lambda: simulate_distributed(path, settings, path.stem),
        "distributed, physics replaced by nothing": lambda: simulate_distributed(
            path, nothing, path.stem
        ),
    }
    goals: tuple[Target | Better, ...] = ("more", DISTRIBUTED, MESSAGING)
    rows = []
    for (name, way), goal in zip(ways.items(), goals, strict=True):
        result, _ = way()
        ticks = Figure.of(result.ticks / result.wall_s, goal)
        rows.append(Row(name, {"ticks/s": ticks, "× real time": Figure.of(result.rtf, "more")}))
    how = f"lockstep, physics at 1 ms; {duration_s:g} s, without the start"
    return [Group("The loop: scenario back", how, tuple(rows))]
