"""Who drives: of all sources of commands, the fresh one of the highest priority, as in twist_mux.

The guard chooses where there is one, else the controller. The choice depends on the messages and
their stamps alone, so it is the same in one process and in many.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

from mecazen.config import Scenario
from mecazen.keys import CMD_VEL, HAND_CMD_VEL, Topic, command_topic, lock_topic
from mecazen.messages import Twist
from mecazen.node import Inputs
from mecazen.ticks import ROUNDING_S

FOLLOWER = "follower"
"""Name of the source of the lowest priority: a node of the scenario that publishes `cmd_vel`."""


class Source(NamedTuple):
    """A source of commands, or a lock."""

    topic: Topic[Any]
    timeout_s: float
    """Age above which a command is not obeyed, and above which a lock is on [s]."""
    name: str
    is_lock: bool = False


def sources(scenario: Scenario) -> tuple[Source, ...]:
    """Return the sources of a robot's commands by falling priority, a lock before its equals."""
    config = scenario.controller
    ordered = sorted(config.commands, key=lambda command: (-command.priority, not command.lock))
    by_hand = [
        Source(
            lock_topic(command.key) if command.lock else command_topic(command.key),
            command.timeout_s or (math.inf if command.lock else config.reference_timeout_s),
            command.key,
            command.lock,
        )
        for command in ordered
    ]
    return (*by_hand, Source(CMD_VEL, config.reference_timeout_s, FOLLOWER))


def topics(scenario: Scenario) -> tuple[Topic[Any], ...]:
    """Return the topics besides `CMD_VEL` from which some robot takes commands."""
    robots = map(scenario.of, scenario.names)
    named = (source.topic for robot in robots for source in sources(robot)[:-1])
    return tuple(dict.fromkeys((HAND_CMD_VEL, *named)))


class Commands:
    """The newest command of each source.

    Args:
        sources: The sources by falling priority.
    """

    def __init__(self, sources: tuple[Source, ...]) -> None:
        self.sources = sources
        self.reset()

    def reset(self) -> None:
        """Forget all commands."""
        self._newest: dict[Topic[Any], Any] = {}
        self.driver = ""
        """Name of the source that drives or of the lock that holds the robot; empty: neither."""

    def age_s(self, inputs: Inputs) -> float:
        """Return the age of the newest command of any source [s]; inf: there is none."""
        return min(inputs.age_s(s.topic) for s in self.sources if not s.is_lock)

    def choose(self, inputs: Inputs) -> Twist | None:
        """Return the command to obey in a step; None if the robot should rest."""
        for source in self.sources:
            if (message := inputs.get(source.topic)) is not None:
                self._newest[source.topic] = message
        for source in self.sources:
            is_stale = inputs.age_s(source.topic) > source.timeout_s + ROUNDING_S
            message = self._newest.get(source.topic)
            if source.is_lock and (is_stale or (message is not None and message.data)):
                self.driver = f"locked by {source.name}"
                return None
            if not (source.is_lock or is_stale or message is None):
                self.driver = source.name
                return cast(Twist, message)
        self.driver = ""
        return None
