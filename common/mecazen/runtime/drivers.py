"""Creation of a process's driver: the clock, a worker or an observer."""

from __future__ import annotations

from collections.abc import Sequence

from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.graph import OBSERVERS
from mecazen.programs import classes
from mecazen.runtime.clock import Clock
from mecazen.runtime.host import Host, Part
from mecazen.runtime.observer import Observer
from mecazen.runtime.worker import Worker


def drive(parts: Sequence[Part], bus: Bus, scenario: Scenario) -> Clock | Worker | Observer:
    """Return the driver of a process's services, ready to run.

    Raises:
        ConfigError: A service does not exist, or the scenario does not suit it.
    """
    if parts[0][0] in OBSERVERS:
        return observe(parts[0][0], bus, scenario)
    host = Host(parts, bus, scenario)
    return Worker(host) if host.world is None else Clock(host)


def observe(service: str, bus: Bus, scenario: Scenario) -> Observer:
    """Return an observer, ready to run; raises as `drive`."""
    (kind,) = classes(service, scenario).values()
    assert issubclass(kind, Observer)  # `classes` refuses other types
    observer = kind(service, bus, scenario)
    observer.reset(scenario.seed)
    return observer
