"""The whole loop: in one process, as processes over Zenoh, and its messages alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mecazen.loading import load_scenario
from mecazen.simulate import Result, simulate, simulate_distributed

from bench.figures import Figure, Group, Row, Target
from bench.scenarios import SCENARIOS

REPETITIONS = 3
DURATION_S = 20.0
STEPS = ("physics.dt_s=0.001",)
NULL_PHYSICS = Path(__file__).with_name("null_physics.py")

DISTRIBUTED = Target.at_least(700.0)
MESSAGING = Target.at_least(2000.0)


def run(duration_s: float = DURATION_S, repetitions: int = REPETITIONS) -> list[Group]:
    """Run the scenario `back` in each of the three ways, in turns."""
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
    targets = dict(zip(ways, (None, DISTRIBUTED, MESSAGING), strict=True))
    results: dict[str, list[Result]] = {name: [] for name in ways}
    for _ in range(repetitions):
        for name, way in ways.items():
            results[name].append(way()[0])
    rows = (
        Row(
            name,
            {
                "ticks/s": Figure.median([r.ticks / r.wall_s for r in found], targets[name]),
                "× real time": Figure.median([r.rtf for r in found]),
            },
        )
        for name, found in results.items()
    )
    how = (
        f"lockstep, physics at 1 ms; medians (quartiles) of {repetitions} runs of "
        f"{duration_s:g} s in turns, without their start"
    )
    return [Group("The loop: scenario back", how, tuple(rows))]
