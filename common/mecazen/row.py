"""A node's row of the graph: what it takes and gives, and how its inputs join a tick."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from mecazen import keys
from mecazen.errors import ConfigError
from mecazen.keys import Call, Topic

Rule = Literal["every", "due", "latest"]


@dataclass(frozen=True)
class Input:
    """A topic that a node takes, and the rule by which its samples join a step."""

    topic: Topic[Any]
    rule: Rule
    revises: bool = False
    """Whether a sample that comes after the step of its tick has the step done again."""
    needs: str = ""
    """The feature of a scenario without which it is not taken ..."""
    unless: str = ""
    """... and one with which it is not."""


def every(topic: Topic[Any]) -> Input:
    """The node makes one step for each sample; of several such inputs, for those of one tick."""
    return Input(topic, "every")


def due(topic: Topic[Any], *, revises: bool = False, needs: str = "", unless: str = "") -> Input:
    """A step waits for the newest sample that is due by its tick, by the topic's rate.

    Where no node of the scenario gives the topic, no step waits.
    """
    return Input(topic, "due", revises, needs, unless)


def latest(topic: Topic[Any]) -> Input:
    """A step waits for nothing, and takes what has come since the last one.

    In lockstep it is "due" of a topic that a node gives: order of arrival counts for nothing.
    """
    return Input(topic, "latest")


@dataclass(frozen=True)
class Row:
    """A node, as the rest of the system sees it."""

    name: str
    summary: str = ""
    """What it does, in a few words."""
    inputs: tuple[Input, ...] = ()
    outputs: tuple[Topic[Any], ...] = ()
    """In the order in which they are published."""
    calls: tuple[Call[Any, Any], ...] = ()
    """The queries that it answers."""
    rates: Mapping[str, str | float] = field(default_factory=dict)
    """Of outputs that do not come with every step, by their keys: the rate [Hz], or the
    configuration key that has it."""
    service: str = ""
    """The service that it is part of: a process, a project, a certificate. Left out: its name."""
    shared: bool = False
    """Whether there is one for all robots; else each robot has its own."""
    observes: bool = False
    """Whether it only observes: no tick waits for it, and its end is no error."""
    owns_time: bool = False
    """Whether it makes the ticks and the runs that all others follow."""
    priority: int = 0
    """Real-time priority among the processes of the stack; 0 has none."""
    resets_with: tuple[str, ...] = ()
    """Services after whose restart the node begins anew."""
    remap: Mapping[str, str] = field(default_factory=dict)
    """Keys on the bus, by the keys of its topics, where they differ."""
    needs: str = ""
    """The feature of a scenario without which it does not take part: `Scenario.features`."""
    offers: Mapping[str, str] = field(default_factory=dict)
    """Features without which it does not give an output, by the outputs' keys."""

    def __post_init__(self) -> None:
        """Check it, as anyone may write one.

        Raises:
            ConfigError: A field is of another type, a topic is there twice, or a rate is of
                no output.
        """
        for name, kind in (("inputs", Input), ("outputs", Topic), ("calls", Call)):
            values = getattr(self, name)
            if not isinstance(values, tuple) or not all(isinstance(v, kind) for v in values):
                raise ConfigError(f"row {self.name}: {name} must be a tuple, each {kind.__name__}")
        for name, topics in (("inputs", [i.topic for i in self.inputs]), ("outputs", self.outputs)):
            given = [topic.key for topic in topics]
            if len(set(given)) != len(given):
                raise ConfigError(f"row {self.name}: {name}: each topic at most once")
        for key, rate in self.rates.items():
            positive = isinstance(rate, int | float) and rate > 0.0
            if key not in {topic.key for topic in self.outputs}:
                raise ConfigError(f"row {self.name}: rates: {key!r} is no key of its outputs")
            if not positive and not isinstance(rate, str):
                raise ConfigError(f"row {self.name}: rates: {key} must be positive, or name a key")

    @property
    def part_of(self) -> str:
        """The name of its service."""
        return self.service or self.name

    def within(self, features: frozenset[str]) -> Row | None:
        """Return what is left of it in a scenario with these features; None: it takes no part."""
        if self.needs and self.needs not in features:
            return None
        left_out = {key for key, feature in self.offers.items() if feature not in features}
        inputs = tuple(
            i
            for i in self.inputs
            if (not i.needs or i.needs in features) and i.unless not in features
        )
        if not left_out and inputs == self.inputs:
            return self
        return replace(
            self,
            inputs=inputs,
            outputs=tuple(topic for topic in self.outputs if topic.key not in left_out),
            rates={key: rate for key, rate in self.rates.items() if key not in left_out},
        )

    def namespaced(self, robots: Iterable[str]) -> Row:
        """Return it with its inputs of each of several robots, where there is one for all."""
        return replace(
            self,
            inputs=tuple(
                replace(i, topic=keys.of_robot(i.topic, robot))
                for i in self.inputs
                for robot in (("",) if i.topic is keys.CLOCK else robots)
            ),
        )

    def feature(self, key: str) -> str:
        """Return the feature without which it does not give an output; "" where it always does."""
        return self.offers.get(key, self.needs)

    def on_bus(self, topic: Topic[Any]) -> Topic[Any]:
        """Return one of its topics with the key that it has on the bus."""
        key = self.remap.get(topic.key, topic.key)
        return topic if key == topic.key else replace(topic, key=key)

    def placed(self, place: Row) -> Row:
        """Return what a class says of itself in its row, in the place of a row of the table."""
        return replace(
            self,
            name=place.name,
            service=place.service,
            shared=place.shared,
            observes=place.observes,
            priority=place.priority,
        )
