"""Latency between containers, beside that between processes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

from mecazen.config import Scenario
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
        processes = latency.drive(stack.scenario, puts)
    with _containers() as scenario:
        containers = latency.drive(scenario, puts)
    rows = (
        Row("processes", latency.figures(processes)),
        Row("containers", latency.figures(containers)),
    )
    return [Group(TITLE, f"`cmd_vel` to `joint_command`: {puts} puts by the host", rows)]


@contextmanager
def _containers() -> Iterator[Scenario]:
    """Run the containers; yield the scenario by which a peer on the host reaches them."""
    with closing(Compose()) as compose:
        compose.run("up", "--detach", *SERVICES)
        yield load_scenario(SCENARIOS / "teleop.toml", (f'bus.connect=["{compose.endpoint}"]',))
