"""Live parameters: the settings of a scenario that queries change during a simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.graph import SHARED
from mecazen.keys import PARAMETERS
from mecazen.loading import in_toml
from mecazen.messages import Parameters
from mecazen.node import Node
from mecazen.parameters import ADDED, changed, refuse_names, refuse_unknown, to_message
from mecazen.programs import classes, reads_section
from mecazen.wire import encode

MOST_BYTES = PARAMETERS.max_bytes - 256
"""Maximum size of all changes, without the header of their message [bytes]."""


class LiveParameters:
    """The parameters of a simulation, which stay in effect for the runs that follow.

    Additions to the world stay until the end of the run. `check` raises ConfigError if a
    scenario does not suit the named service, and `check_world` if it does not suit the robots now.
    """

    def __init__(
        self,
        scenario: Scenario,
        check: Callable[[Scenario, str], None],
        check_world: Callable[[Scenario], None],
    ) -> None:
        self._start = scenario
        self._check, self._check_world = check, check_world
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
        settings = in_toml(settings)
        things = {key: value for key, value in settings.items() if key.startswith(ADDED)}
        fields = settings.keys() - things.keys()
        refuse_unknown(self._start, fields)
        refuse_names(self.requested, things)
        unchanged = {k: v for k, v in self._requested.items() if k not in settings}
        requested = {**unchanged, **settings}
        scenario = changed(self._start, requested)
        if len(encode(Parameters(parameters=to_message(requested)))) > MOST_BYTES:
            raise ConfigError("too many changes in one run; a reset undoes those of the world")
        for name in {part for key in fields for part in key.split(".")}:
            if name in scenario.services:
                self._check(scenario, name)
        if things:
            self._check_world(scenario)
        self.requested, self._requested = scenario, requested

    def begin(self) -> None:
        """Begin a run: its world is that of the scenario again, from the first tick on."""
        kept = {key: v for key, v in self._requested.items() if not key.startswith(ADDED)}
        if kept != self._requested:
            self.requested, self._requested = changed(self._start, kept), kept

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
