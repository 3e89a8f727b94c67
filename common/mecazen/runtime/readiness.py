"""Who is alive and who is ready: liveliness tokens of services."""

from __future__ import annotations

from collections.abc import Iterator

from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.graph import OBSERVERS, SHARED


def declare_alive(bus: Bus, service: str, scenario: Scenario) -> None:
    """Hold a service's token; one that several robots share holds it in each one's namespace."""
    for robot in _namespaces(scenario):
        bus.namespaced(robot).declare_alive(service)


def announce_readiness(bus: Bus, service: str, scenario: Scenario) -> None:
    """Declare `<service>/ready` once every other service of the scenario is seen alive.

    In real time observers are not waited for: they are never needed.

    A service that sees another's token has a link to it, and the other's subscriptions are
    known on it. When all are ready, all links of the loop stand, so no first sample is lost.
    """
    others = set(scenario.services) - {service}
    if scenario.sim.mode == "real_time":
        others -= set(OBSERVERS)
    for robot in _namespaces(scenario):
        # where there are several robots, only what they share is in no one's namespace
        here = others & set(SHARED) if scenario.robots and not robot else others
        _announce_readiness(bus.namespaced(robot), service, here)


def _announce_readiness(bus: Bus, service: str, others: set[str]) -> None:
    announced = False

    def check() -> None:
        nonlocal announced
        if not announced and others <= bus.presence.names:
            announced = True
            bus.declare_alive(f"{service}/ready")

    bus.presence.on_change.append(check)
    check()


def _namespaces(scenario: Scenario) -> Iterator[str]:
    return iter(dict.fromkeys(("", *scenario.names)))
