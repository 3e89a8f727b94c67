"""What seeing for itself costs: the loop with each kind of sensor, and where the time goes."""

from __future__ import annotations

from mecazen.loading import load_scenario
from mecazen_tools.simulate import simulate

from mecazen_bench.figures import Better, Figure, Group, Row, Target
from mecazen_bench.loop import DURATION_S, PATH, parts

KINDS = ("pose", "body", "legs", "fused")
LEAST_RATIO = Target(low=0.8)
"""Of the real-time factor with the sensor of poses: 20 of 25."""


def run(duration_s: float = DURATION_S) -> list[Group]:
    """Run the scenario `back` with each kind of sensor."""
    settings = (f"sim.duration_s={duration_s}",)
    factors = {
        kind: simulate(load_scenario(PATH, (*settings, f"sensor.kind={kind}")), PATH.stem)[0].rtf
        for kind in KINDS
    }
    rows = []
    for kind, factor in factors.items():
        goal: Target | Better = "more" if kind == "pose" else LEAST_RATIO
        figures = {
            "× real time": Figure.of(factor, "more"),
            "of pose": Figure.of(factor / factors["pose"], goal),
        }
        rows.append(Row(kind, figures))
    how = f"in one process; {duration_s:g} s"
    title = "Kinds of sensor: scenario back"
    return [Group(title, how, tuple(rows)), parts((*settings, "sensor.kind=fused"), duration_s)]
