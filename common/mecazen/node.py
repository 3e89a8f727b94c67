"""Nodes: classes that compute outputs from inputs, tick by tick.

A node knows no bus, no wall clock and no stamps. `mecazen.loop` passes the inputs to the node and
publishes the outputs that it returns, whether nodes share a process or each has its own.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

from mecazen.config import Scenario
from mecazen.keys import Call, Topic
from mecazen.messages import Message, MessageT, Time
from mecazen.row import Row, due, every, latest
from mecazen.schema import Section
from mecazen.wire import NS_PER_S

__all__ = ["Inputs", "Node", "Outputs", "Row", "Tick", "due", "every", "latest"]


Outputs = Mapping[Topic[Any], Message]
"""Messages that a step returns, by topic, in the order of publication."""


class Tick(NamedTuple):
    """The instant of a step, in simulated time."""

    number: int
    """The tick's number; the first of a run is 0."""
    time_ns: int
    """Simulated time since the start of the run [ns]."""
    period_s: float
    """Time since the node's last step [s]: one control period at the first step, and 0 if the step
    of this tick is repeated because a newer input has arrived."""

    @property
    def time(self) -> Time:
        """The simulated time, for headers of messages."""
        return Time.from_ns(self.time_ns)


class Inputs:
    """The samples that have arrived since a node's last step, by topic.

    Args:
        samples: The newest message of each topic, if one has arrived.
        known_ns: Time of the newest message that earlier steps have used, by topic [ns].
        now_ns: Simulated time [ns].
        due_ns: Time of each late sample: that of the step it was meant for [ns].
    """

    __slots__ = ("_due_ns", "_known_ns", "_now_ns", "refused", "samples")

    def __init__(
        self,
        samples: Mapping[Topic[Any], Message],
        known_ns: Mapping[Topic[Any], int] | None = None,
        now_ns: int = 0,
        due_ns: Mapping[Topic[Any], int] | None = None,
    ) -> None:
        self.samples = samples
        """Messages that the node has not refused, by topic."""
        self._known_ns = known_ns or {}
        self._now_ns = now_ns
        self._due_ns = due_ns or {}
        self.refused: list[tuple[Topic[Any], str]] = []
        """Topics of the messages that the node refused, each with the reason."""

    def __getitem__(self, topic: Topic[MessageT]) -> MessageT:
        """Return the message that has arrived on a topic.

        Raises:
            KeyError: No message has arrived since the last step.
        """
        return self.samples[topic]  # type: ignore[return-value]  # a topic carries its type

    def get(self, topic: Topic[MessageT]) -> MessageT | None:
        """Return the topic's message, or None if none has arrived since the last step."""
        return self.samples.get(topic)  # type: ignore[return-value]

    def age_s(self, topic: Topic[Any]) -> float:
        """Return the age of a topic's newest message [s]; inf: there is none.

        The age counts from the step that the message was meant for. So a message that arrives in
        time has the age 0 in its step.
        """
        if topic in self.samples:
            return (self._now_ns - self._due_ns.get(topic, self._now_ns)) / NS_PER_S
        return self.gap_s(topic)

    def gap_s(self, topic: Topic[Any]) -> float:
        """Return the age of a topic's newest message in earlier steps [s]; inf: there is none."""
        known_ns = self._known_ns.get(topic)
        return math.inf if known_ns is None else (self._now_ns - known_ns) / NS_PER_S

    def refuse(self, topic: Topic[Any], reason: str) -> None:
        """Refuse a message: drop it, count it and report the reason."""
        self.refused.append((topic, reason))
        self.samples = {key: m for key, m in self.samples.items() if key is not topic}


class Node(ABC):
    """Base class of nodes: of one robot, or of all robots as the world and the crowd.

    A node of all robots refers to a robot's topics and calls by `of_robot` and `call_of_robot`.
    """

    ROW: ClassVar[Row | None] = None
    """The row of a user node; a class without one has the row of the node that it replaces."""

    SECTION: ClassVar[type[Section] | None] = None
    """Type of the node's section of a scenario, if the node is no installed service."""

    def __init__(self, scenario: Scenario) -> None:
        """Store the configuration; `reset` creates the state of a run."""
        self.scenario = scenario

    @abstractmethod
    def reset(self, seed: int) -> None:
        """Begin a run: return to the initial state and seed the random numbers."""

    @abstractmethod
    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the outputs of a tick.

        Args:
            tick: The instant, and the time since the last step.
            inputs: The samples that have arrived since then. Inputs of rule "every" are always
                present.
        """

    def answer(self, call: Call[Any, Any], request: Message) -> Message:
        """Return the answer to a query that the row names.

        Raises:
            RefusedError: The query can't be answered; the message says why.
        """
        raise NotImplementedError(f"{call.key} is in the row and has no answer")

    def files(self) -> Mapping[str, Mapping[str, bytes]]:
        """Return files to serve besides answers, by key and by path below the key."""
        return {}

    def configure(self, scenario: Scenario) -> None:
        """Apply changed live parameters between two steps.

        Attributes that refer to a section of the scenario, such as `self.config`, are replaced. A
        class overrides this method to recompute values that its constructor derives from the
        configuration. The state of the run is kept.
        """
        for name in self.scenario.__struct_fields__:
            section = getattr(self.scenario, name)
            for attribute, value in vars(self).items():
                if isinstance(value, Section) and value is section:
                    vars(self)[attribute] = getattr(scenario, name)
        self.scenario = scenario

    def check_world(self, scenario: Scenario) -> None:  # noqa: B027  # most allow every change
        """Raise ConfigError if the state of the run does not allow a changed world.

        Only nodes in the process of the clock are asked, before `configure`.
        """

    def diagnostics(self) -> Mapping[str, object]:
        """Return values on the node's health, by name; called once a simulated second."""
        return {}

    def close(self) -> None:  # noqa: B027  # most have nothing to do
        """Release resources, such as files and devices.

        Called once after `reset`, also if another node fails to start. The bus may be gone, so no
        output is left to publish. If it raises, the other nodes are closed first, then the process
        exits with the error.
        """
