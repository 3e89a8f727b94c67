"""Rows of the graph: a node's inputs and outputs, and the rules by which inputs join a tick."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from mecazen.errors import ConfigError
from mecazen.keys import Call, Topic

Rule = Literal["every", "due", "latest"]


@dataclass(frozen=True)
class Input:
    """A topic that a node subscribes to, and the rule by which its samples join a step."""

    topic: Topic[Any]
    rule: Rule
    revises: bool = False
    """Whether a sample that arrives after the step of its tick repeats that step."""
    before: bool = False
    """Whether a step uses the sample of the tick before; its giver may then wait for the step."""


def every(topic: Topic[Any]) -> Input:
    """Return an input that triggers a step: one for each tick with a sample of all such inputs."""
    return Input(topic, "every")


def due(topic: Topic[Any], *, revises: bool = False, before: bool = False) -> Input:
    """Return an input that a step waits for: the newest sample due by its tick, by topic rate.

    If no node of the scenario publishes the topic, no step waits for it.
    """
    return Input(topic, "due", revises, before)


def latest(topic: Topic[Any], *, revises: bool = False) -> Input:
    """Return an input with the newest sample since the last step, if any; no step waits for it.

    In lockstep the rule is "due" instead if a node publishes the topic, so that results do not
    depend on the order of arrival.
    """
    return Input(topic, "latest", revises)


@dataclass(frozen=True)
class Row:
    """The interface of a node: its topics, its calls, and its place among the services."""

    name: str
    summary: str = ""
    """Purpose of the node, in a few words."""
    inputs: tuple[Input, ...] = ()
    outputs: tuple[Topic[Any], ...] = ()
    """Topics that it publishes, in this order."""
    calls: tuple[Call[Any, Any], ...] = ()
    """Queries that it answers."""
    rates: Mapping[str, str | float] = field(default_factory=dict)
    """Rates of outputs that are not published at every step, by output key: a number [Hz] or the
    configuration key of the rate."""
    service: str = ""
    """Service that the node is part of: a process, a project, a certificate. Default: its name."""
    shared: bool = False
    """Whether one node serves all robots; otherwise each robot has its own."""
    observes: bool = False
    """Whether it only observes: no tick waits for it, and its exit is no error."""
    owns_time: bool = False
    """Whether it starts the ticks and runs that all other nodes follow."""
    priority: int = 0
    """Real-time priority among the processes of the stack; 0: none."""
    resets_with: tuple[str, ...] = ()
    """Services whose restart resets the node."""
    program: str = ""
    """Class of the node in this distribution, as `module:Class`; a user node has none."""

    def __post_init__(self) -> None:
        """Check the fields, since users write rows too.

        Raises:
            ConfigError: A topic occurs twice, or a rate is invalid or belongs to no output.
        """
        for name, topics in (("inputs", [i.topic for i in self.inputs]), ("outputs", self.outputs)):
            if len({(topic.key, topic.by_hand) for topic in topics}) != len(topics):
                raise ConfigError(f"row {self.name}: {name}: each topic at most once")
        for key, rate in self.rates.items():
            positive = isinstance(rate, int | float) and rate > 0.0
            if key not in {topic.key for topic in self.outputs}:
                raise ConfigError(f"row {self.name}: rates: {key!r} is no key of its outputs")
            if not positive and not isinstance(rate, str):
                raise ConfigError(f"row {self.name}: rates: {key} must be positive, or name a key")

    @property
    def part_of(self) -> str:
        """Name of the service that the node is part of."""
        return self.service or self.name

    @property
    def gives(self) -> tuple[str, ...]:
        """The keys of its outputs and of the queries that it answers."""
        return *(topic.key for topic in self.outputs), *(call.key for call in self.calls)

    def placed(self, place: Row) -> Row:
        """Return the row of a class with name, service and role of the node that it replaces."""
        return replace(
            self,
            name=place.name,
            service=place.service,
            shared=place.shared,
            observes=place.observes,
            priority=place.priority,
        )
