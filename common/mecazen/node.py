"""What a node is: a class that computes its outputs from its inputs, tick by tick.

It knows no bus, no wall clock and no stamps; `mecazen.loop` gives it its inputs and publishes
what it returns, whether all nodes share a process or each has its own.
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

__all__ = ["Inputs", "Node", "Outputs", "Row", "Tick", "World", "due", "every", "latest"]


Outputs = Mapping[Topic[Any], Message]
"""What a step gives, by topic, in the order in which it is published."""


class Tick(NamedTuple):
    """The instant of a step, in simulated time."""

    number: int
    """The tick's number; the first of a run is 0."""
    time_ns: int
    """Simulated time since the start of the run [ns]."""
    period_s: float
    """Time since the node's last step [s]: one control period at the first. 0 where the step of
    this tick is done again, because a newer input has come."""

    @property
    def time(self) -> Time:
        """The simulated time, for headers of messages."""
        return Time.from_ns(self.time_ns)


class Inputs:
    """The samples that have come since a node's last step, by topic.

    Args:
        samples: The newest message of each topic that has one.
        known_ns: When each topic's last message was used before this step [ns].
        now_ns: Simulated time [ns].
    """

    __slots__ = ("_known_ns", "_now_ns", "refused", "samples")

    def __init__(
        self,
        samples: Mapping[Topic[Any], Message],
        known_ns: Mapping[Topic[Any], int] | None = None,
        now_ns: int = 0,
    ) -> None:
        self.samples = samples
        """What the node has not refused."""
        self._known_ns = known_ns or {}
        self._now_ns = now_ns
        self.refused: list[tuple[Topic[Any], str]] = []
        """What the node could not use, and why."""

    def __getitem__(self, topic: Topic[MessageT]) -> MessageT:
        """Return a message that has come.

        Raises:
            KeyError: None has.
        """
        return self.samples[topic]  # type: ignore[return-value]  # a topic carries its type

    def get(self, topic: Topic[MessageT]) -> MessageT | None:
        """Return a message, or None where none has come since the last step."""
        return self.samples.get(topic)  # type: ignore[return-value]

    def age_s(self, topic: Topic[Any]) -> float:
        """Return for how long the topic's newest message has been known [s]; inf: never."""
        return 0.0 if topic in self.samples else self.gap_s(topic)

    def gap_s(self, topic: Topic[Any]) -> float:
        """Return how long before this step a topic's last message was used [s]; inf: never."""
        known_ns = self._known_ns.get(topic)
        return math.inf if known_ns is None else (self._now_ns - known_ns) / NS_PER_S

    def renamed(self, topics: Mapping[Topic[Any], Topic[Any]]) -> Inputs:
        """Return the inputs of some topics, by other topics."""
        samples = {to: self.samples[topic] for topic, to in topics.items() if topic in self.samples}
        known = {to: self._known_ns[of] for of, to in topics.items() if of in self._known_ns}
        return Inputs(samples, known, self._now_ns)

    def refuse(self, topic: Topic[Any], reason: str) -> None:
        """Refuse a message: it is counted and reported, as if it had never come."""
        self.refused.append((topic, reason))
        self.samples = {other: m for other, m in self.samples.items() if other is not topic}


class Computing(ABC):
    """What nodes and worlds have in common."""

    ROW: ClassVar[Row]
    """Its row of the graph. Classes of ours refer to the table's, others bring their own."""

    SECTION: ClassVar[type[Section] | None] = None
    """The type of its section of a scenario, where it is not an installed service's."""

    def __init__(self, scenario: Scenario) -> None:
        """Take the configuration; what belongs to a run is made in `reset`."""
        self.scenario = scenario

    @classmethod
    def row(cls, scenario: Scenario) -> Row:
        """Return the node's row, where its configuration changes it."""
        del scenario
        return cls.ROW

    @abstractmethod
    def reset(self, seed: int) -> None:
        """Begin a run: back to the start, with random numbers from `seed`."""

    def configure(self, scenario: Scenario) -> None:
        """Go on with a configuration in which live parameters have changed, between two steps.

        An attribute that is a section, as `self.config` mostly is, is the new one from now on. What
        the constructor has made of the old one, a class makes anew here; what belongs to the run
        stays.
        """
        for name in self.scenario.__struct_fields__:
            section = getattr(self.scenario, name)
            for attribute, value in vars(self).items():
                if isinstance(value, Section) and value is section:
                    vars(self)[attribute] = getattr(scenario, name)
        self.scenario = scenario

    def diagnostics(self) -> Mapping[str, object]:
        """Return what it says of its health, by name, once a second of simulated time."""
        return {}

    def close(self) -> None:  # noqa: B027  # most have nothing to do
        """End the work."""


class Node(Computing):
    """A node of one robot."""

    @abstractmethod
    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the outputs of a tick.

        Args:
            tick: The instant, and the time since the last step.
            inputs: What has come since then. Those of rule "every" are always there.
        """

    def answer(self, call: Call[Any, Any], request: Message) -> Message:
        """Return the answer to a query that the row names.

        Raises:
            RefusedError: The query can't be answered; the message says why.
        """
        raise NotImplementedError(f"{call.key} is in the row and has no answer")


class World(Computing):
    """What simulated time advances: the physics of all robots, a recording, or hardware.

    Robots go by their names; a single one has the empty one.
    """

    @abstractmethod
    def step(self, tick: Tick, inputs: Mapping[str, Inputs]) -> Mapping[str, Outputs]:
        """Advance by a tick's period with the answers to the tick before; return the new state.

        At tick 0 there is nothing to advance: the state at the start of a run is returned.
        """

    def answer(self, call: Call[Any, Any], request: Message, robot: str) -> Message:
        """Return the answer to a query that the row names, asked of one robot.

        Raises:
            RefusedError: The query can't be answered; the message says why.
        """
        raise NotImplementedError(f"{call.key} is in the row and has no answer")

    def files(self, robot: str) -> Mapping[str, Mapping[str, bytes]]:
        """Return files that are served beside the answers: by key, and by path below it."""
        del robot
        return {}
