"""Latency once more: the same services in containers, and as processes, in turns."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Scenario
from mecazen.errors import MecazenError
from mecazen.loading import load_scenario

from mecazen_bench import latency
from mecazen_bench.compose import Compose
from mecazen_bench.figures import Group, Row
from mecazen_bench.scenarios import SCENARIOS

PUTS = 500
SERVICES = ("router", "teleop-physics", "teleop-controller", "teleop-target")
TITLE = "Latency in containers: scenario teleop"


def run(puts: int = PUTS) -> list[Group]:
    """Drive the scenario `teleop` as processes and in containers; or say why there are none."""
    try:
        Compose().run("build", *SERVICES)
    except MecazenError as error:
        return [Group(TITLE, str(error), ())]
    rows = []
    for subject, running in (("processes", latency.teleop), ("containers", _teleop)):
        with running() as scenario, closing(ZenohBus(scenario.bus)) as bus:
            rows.append(Row(subject, latency.figures(latency.drive(bus, scenario, puts))))
    how = f"cmd_vel → joint_command: {puts} puts by a process of the host"
    return [Group(TITLE, how, tuple(rows))]


@contextmanager
def _teleop() -> Iterator[Scenario]:
    """Run the containers meanwhile; yield how to reach them.

    As a peer, as among processes, who finds them by gossip, and whom not the router relays to.
    """
    with closing(Compose()) as compose:
        compose.run("up", "--detach", *SERVICES)
        yield load_scenario(SCENARIOS / "teleop.toml", (f'bus.connect=["{compose.endpoint}"]',))
