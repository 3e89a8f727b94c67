"""Makes the services of a scenario on a bus, each with the part of the scenario that it sees."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import cast

from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.graph import SHARED
from mecazen.node import Node, World
from mecazen.parameters import changed
from mecazen.programs import Kind, classes, graph_of
from mecazen.runtime.clock import TimeOwner
from mecazen.runtime.observer import Observer
from mecazen.runtime.participant import Participant
from mecazen.runtime.service import Service


def part_of(service: str, scenario: Scenario, robot: str) -> Scenario:
    """Return the scenario as a service sees it: whole, or as one of several robots does.

    Raises:
        ConfigError: There is no such robot, or a robot must be named, or none.
    """
    if service in SHARED and robot:
        raise ConfigError(f"--robot {robot}: there is one {service} for all robots")
    if service not in SHARED and scenario.robots and not robot:
        raise ConfigError(f"{service}: of which robot? --robot takes {' or '.join(scenario.names)}")
    return scenario if service in SHARED else scenario.of(robot)


def make_service(service: str, bus: Bus, scenario: Scenario, robot: str = "") -> Participant:
    """Return a service, ready to run.

    Args:
        service: Its name.
        bus: Without a robot's namespace.
        scenario: The whole scenario.
        robot: Whose service, where there are several robots.

    Raises:
        ConfigError: There is no such service, or the scenario does not suit it.
    """
    return make_nodes(service, classes(service, scenario), bus, scenario, robot)


def make_nodes(
    service: str, kinds: Mapping[str, Kind], bus: Bus, scenario: Scenario, robot: str = ""
) -> Participant:
    """Return a service of these classes, by the names of its nodes; see `make_service`."""
    see = partial(part_of, service, robot=robot)
    seen = see(scenario)
    bus = bus.namespaced(robot)
    kind = next(iter(kinds.values()))
    if issubclass(kind, Observer):
        observer = kind(service, bus, seen)
        observer.reset(seen.seed)
        return observer
    graph = graph_of(seen, kinds)
    if issubclass(kind, World):
        return TimeOwner(service, bus, seen, graph, kind)
    made = Service(service, bus, seen, graph, cast(Mapping[str, type[Node]], kinds))
    made.take_changes(lambda settings: see(changed(scenario, settings)))
    return made
