"""Latency between containers, beside that between processes."""

from __future__ import annotations

from contextlib import closing

from mecazen.errors import MecazenError
from mecazen.loading import load_scenario

from mecazen_bench import latency
from mecazen_bench.compose import Compose
from mecazen_bench.figures import Group, Row
from mecazen_bench.stack import SCENARIOS, running

PUTS = 500
SERVICES = ("router", "teleop-physics", "teleop-controller", "teleop-target")
TITLE = "Latency in containers: scenario teleop"


def run(puts: int = PUTS) -> list[Group]:
    """Drive the scenario `teleop` as processes and in containers, where Docker is available."""
    try:
        Compose().run("build", *SERVICES)
    except MecazenError as error:
        return [Group(TITLE, str(error), ())]
    with running("teleop") as stack:
        processes = latency.figures(latency.drive(stack.scenario, puts))
    with closing(Compose()) as compose:
        compose.run("up", "--detach", *SERVICES)
        reached = (f'bus.connect=["{compose.endpoint}"]',)
        scenario = load_scenario(SCENARIOS / "teleop.toml", reached)
        containers = latency.figures(latency.drive(scenario, puts))
    rows = Row("processes", processes), Row("containers", containers)
    return [Group(TITLE, f"`cmd_vel` to `joint_command`: {puts} puts by the host", rows)]
