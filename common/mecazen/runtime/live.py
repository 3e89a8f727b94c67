"""Live parameters: the settings of a scenario that queries change during a simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.graph import SHARED
from mecazen.node import Node
from mecazen.parameters import changed, refuse_unknown
from mecazen.programs import classes, reads_section


class LiveParameters:
    """The parameters of a simulation, which stay in effect for the runs that follow.

    `check` raises ConfigError if a scenario does not suit the named service.
    """

    def __init__(self, scenario: Scenario, check: Callable[[Scenario, str], None]) -> None:
        self._start = scenario
        self._check = check
        self.scenario = self.requested = scenario
        """The scenario that applies now, and the one from the next tick on."""
        self.settings: dict[str, Any] = {}
        """Changed parameters: values by key, in the order of the changes."""
        self._requested: dict[str, Any] = {}

    def set(self, settings: Mapping[str, Any]) -> None:
        """Change parameters from the next tick on.

        Raises:
            ConfigError: A parameter is not live or a value is invalid; then nothing changes.
        """
        refuse_unknown(self._start, settings)
        unchanged = {k: v for k, v in self._requested.items() if k not in settings}
        scenario = changed(self._start, {**unchanged, **settings})
        for name in {part for key in settings for part in key.split(".")}:
            if name in scenario.services:
                self._check(scenario, name)
        self.requested, self._requested = scenario, {**unchanged, **settings}

    def apply(self) -> bool:
        """Apply what has been set since the last tick; return whether a value differs."""
        if self._requested == self.settings:
            return False
        self.settings, self.scenario = self._requested, self.requested
        return True


def refuse_unsuitable(scenario: Scenario, service: str) -> None:
    """Refuse changed settings that a node of a service rejects; accept them if none is installed.

    Raises:
        ConfigError: The node's constructor rejects them, or a user's class does not read them.
    """
    try:
        kinds = classes(service, scenario)
    except ConfigError:
        return
    if not reads_section(service, kinds):
        program = scenario.programs[service]
        raise ConfigError(
            f"{service}: no effect on {program}, which takes its place; if it reads "
            f"scenario.{service}, let it name the type as its SECTION"
        )
    shared = service in SHARED
    for part in (scenario,) if shared else map(scenario.of, scenario.names):
        for kind in kinds.values():
            if issubclass(kind, Node):
                kind(part)
