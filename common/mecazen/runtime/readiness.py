"""Readiness: a service declares a liveliness token once it has seen all other services."""

from __future__ import annotations

from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.graph import OBSERVERS
from mecazen.robots import join_key
from mecazen.runtime.pace import EVERY, RECORD

READY = "ready"
"""A liveliness token `<name>/ready` means that its holder has seen all other services."""


def announce_readiness(bus: Bus, service: str, robot: str, scenario: Scenario) -> None:
    """Declare `<service>/ready` once every other service of the scenario is seen alive.

    In real time the service does not wait for observers, since no service needs them. From now on
    the bus notes only tokens of the scenario.

    A service that sees another's token has a link to it and knows its subscriptions. Once all
    services are ready, all links exist, so no first sample is lost.
    """
    bus.presence.known = _tokens(scenario)
    awaited = {join_key(*part) for part in scenario.parts} - {join_key(service, robot)}
    if scenario.sim.mode == "real_time":
        awaited -= set(OBSERVERS)
    announced = False

    def check() -> None:
        nonlocal announced
        if not announced and awaited <= bus.presence.names:
            announced = True
            bus.declare_alive(f"{service}/{READY}", robot)

    bus.presence.on_change.append(check)
    check()


def _tokens(scenario: Scenario) -> set[str]:
    """Return the names of the liveliness tokens that count in a scenario."""
    parts = {join_key(*part) for part in scenario.parts} | {*OBSERVERS, RECORD}
    return parts | {f"{part}/{state}" for part in parts for state in (READY, EVERY)}
