"""Changes of parameters during a simulation: from the scenario's script or from queries."""

from __future__ import annotations

from collections.abc import Callable

from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.graph import SHARED
from mecazen.node import Node
from mecazen.parameters import changed, flat, refuse_unknown
from mecazen.programs import classes, reads_section
from mecazen.ticks import whole_ticks

Settings = dict[str, str]
"""Values in TOML by key, in the order of the changes."""


class Changing:
    """The parameters of a simulation: from the scenario, from its script, and from queries.

    Values that a query sets stay in effect for the following runs. The script restarts with each
    run. `check` raises ConfigError if a scenario does not suit the named service.

    Raises:
        ConfigError: The script changes a parameter that is not live, or to an invalid value.
    """

    def __init__(self, scenario: Scenario, check: Callable[[Scenario, str], None]) -> None:
        self._started = scenario
        self._check = check
        self.scenario = self.wanted = scenario
        """The scenario that applies now, and the one once all requested changes are due."""
        self.revision = 0
        """Number of changes so far."""
        self.settings: Settings = {}
        """Parameters that differ from the start."""
        self._kept: Settings = {}
        self._asked: Settings = {}
        self._script: dict[int, Settings] = {}
        for number, change in enumerate(scenario.changes):
            where = f"changes[{number}]"
            tick = whole_ticks(f"{where}.at_s", change.at_s, scenario.sim.tick_s)
            try:
                self._try(settings := flat(change.set))
            except ConfigError as error:
                raise ConfigError(f"{where}: {error}") from None
            self._script[tick] = _laid(self._script.get(tick, {}), settings)

    def ask(self, settings: Settings) -> None:
        """Change parameters from the next tick on.

        Raises:
            ConfigError: A parameter is not live or a value is invalid; then nothing changes.
        """
        self.wanted = self._try(settings)
        self._asked = _laid(self._asked, settings)

    def _try(self, settings: Settings) -> Scenario:
        refuse_unknown(self._started, settings)
        scenario = changed(self.wanted, settings)
        for name in {part for key in settings for part in key.split(".")}:
            if name in scenario.services:
                self._check(scenario, name)
        return scenario

    def take(self, tick: int) -> bool:
        """Apply the changes due at a tick; return whether a value differs from the tick before."""
        if tick and not self._asked and tick not in self._script:
            return False
        self._kept = _laid(self._kept, self._asked)
        before = _laid(self.settings, self._asked) if tick else self._kept
        settings = _laid(before, self._script.get(tick, {}))
        self._asked = {}
        if settings == self.settings:
            return False
        self.settings = settings
        self.scenario = self.wanted = changed(self._started, settings)
        self.revision += 1
        return True


def _laid(below: Settings, above: Settings) -> Settings:
    """Return merged settings; those `above` override those `below` and come last."""
    return {key: value for key, value in below.items() if key not in above} | above


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
