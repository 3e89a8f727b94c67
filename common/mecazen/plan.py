"""The plan: the graph of a scenario, compiled into the order of turns within a tick.

Every process compiles the same plan from the same scenario. So all processes take the turns in
the same order, and no two of them wait for each other.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.graph import Graph
from mecazen.keys import CLOCK, Topic, of_robot
from mecazen.robots import join_key
from mecazen.row import Input, Row, Rule


@dataclass(frozen=True)
class Need:
    """An input of a turn."""

    topic: Topic[Any]
    """The topic as the node refers to it."""
    on_bus: Topic[Any]
    """The topic with its full key."""
    robot: str
    """Robot that the topic belongs to; empty for a single robot and for shared topics."""
    rule: Rule
    """The rule that applies in this run."""
    giver: int | None
    """Number of the turn that publishes it; None if only other programs publish it."""
    period: int
    """Number of ticks from one sample to the next."""
    lag: int
    """Number of ticks between a sample and the step that uses it: 1 for the world and for inputs of
    the tick before, else 0."""
    revises: bool
    """Whether a sample that arrives after the step of its tick repeats that step."""

    def awaited_at(self, tick: int, last: int | None) -> int | None:
        """Return the tick of the sample that the step of `tick` waits for; None: no wait.

        Args:
            tick: The tick of the step.
            last: The tick of the turn's last step; None before the first.
        """
        newest = tick - self.lag
        if self.rule == "latest" or newest < 0:
            return None
        due = newest - newest % self.period
        before = newest - 1 if last is None else last - self.lag
        return due if due > before else None


@dataclass(frozen=True)
class Turn:
    """A node of one robot or of all robots, with its place in the order."""

    number: int
    row: Row
    robot: str
    """Robot that the node belongs to; empty for a single robot and for shared nodes."""
    period: int
    """Number of ticks from one step to the next; 0: the node makes no steps."""
    needs: tuple[Need, ...]
    gives: tuple[tuple[Topic[Any], Topic[Any], int], ...]
    """Outputs: the topic as the node refers to it, the topic with its full key, and the number of
    ticks between samples."""
    is_world: bool = False

    @property
    def name(self) -> str:
        """The node's name, preceded by the robot's name if there are several robots."""
        return join_key(self.row.name, self.robot)

    @property
    def service(self) -> str:
        """The service's name, preceded by the robot's name if there are several robots."""
        return join_key(self.row.part_of, self.robot)


@dataclass(frozen=True)
class Plan:
    """The turns of a scenario, in the order in which they are taken within a tick."""

    turns: tuple[Turn, ...]

    def of(self, parts: Iterable[tuple[str, str]]) -> tuple[Turn, ...]:
        """Return the turns of services, each given as its name and its robot."""
        wanted = {join_key(*part) for part in parts}
        return tuple(turn for turn in self.turns if turn.service in wanted)

    def giver(self, need: Need) -> Turn | None:
        """Return the turn that publishes an input."""
        return None if need.giver is None else self.turns[need.giver]

    def depth(self, need: Need) -> int:
        """Return how many turns of a tick, one after the other, an input's publisher waits for."""
        giver = self.giver(need)
        needs = () if giver is None else giver.needs
        waits = [n for n in needs if n.giver is not None and not n.lag and n.rule != "latest"]
        return max((1 + self.depth(n) for n in waits), default=0)

    def awaited(self) -> frozenset[str]:
        """Return the services that the world waits for, directly or not, and its own service."""
        found: set[int] = set()
        open_ = [turn.number for turn in self.turns if turn.is_world]
        while open_:
            number = open_.pop()
            if number not in found:
                found.add(number)
                needs = self.turns[number].needs
                open_ += [n.giver for n in needs if n.giver is not None and n.rule != "latest"]
        return frozenset(self.turns[number].service for number in found)


def compile_plan(scenario: Scenario, graph: Graph) -> Plan:
    """Return the plan of a scenario.

    Raises:
        ConfigError: A rate does not divide the tick rate, or nodes wait for each other.
    """
    drafts = [
        _Draft(row, robot, scenario, graph)
        for row in graph.rows
        if not row.observes and not row.owns_time
        for robot in (("",) if row.shared else scenario.names)
    ]
    givers = {on_bus.key: draft for draft in drafts for _, on_bus, _ in draft.gives}
    ordered = _ordered(drafts, givers)
    numbers = {id(draft): number for number, draft in enumerate(ordered)}
    return Plan(
        tuple(
            Turn(
                number,
                draft.row,
                draft.robot,
                draft.period,
                tuple(
                    draft.need(given, numbers.get(id(givers.get(given.on_bus.key))))
                    for given in draft.takes
                ),
                draft.gives,
                draft.is_world,
            )
            for number, draft in enumerate(ordered)
        )
    )


@dataclass(frozen=True)
class _Taken:
    """An input of a row for one robot."""

    input: Input
    """The input with the rule that applies in this run."""
    on_bus: Topic[Any]
    robot: str
    period: int


class _Draft:
    """A turn before it has a number."""

    def __init__(self, row: Row, robot: str, scenario: Scenario, graph: Graph) -> None:
        self.row, self.robot = row, robot
        self.is_world = graph.is_world(row)
        own = scenario.of(robot) if robot else scenario
        names = scenario.names if row.shared else (robot,)

        def ticks(topic: Topic[Any]) -> int:
            return own.ticks_per(graph.rate(topic.key))

        for rate in row.rates.values():
            own.ticks_per(rate)  # refuses a rate that does not divide the tick rate
        lockstep = scenario.sim.mode == "lockstep"
        self.takes = [
            _Taken(i, of_robot(i.topic, name), name, ticks(i.topic))
            for i in graph.resolved(row, lockstep=lockstep)
            for name in (("",) if i.topic.shared or i.topic is CLOCK else names)
        ]
        outputs = row.outputs
        if self.is_world:
            outputs = (CLOCK, *outputs)
            names = tuple(dict.fromkeys(("", *names)))
        self.gives = tuple(
            (self._known(topic, name), of_robot(topic, name), ticks(topic))
            for topic in outputs
            for name in names
            # only the clock also has a topic outside the robots' namespaces
            if topic is CLOCK or name in scenario.names
        )
        triggers = [taken.period for taken in self.takes if taken.input.rule == "every"]
        self.period = 1 if self.is_world else math.lcm(*triggers) if triggers else 0

    def _known(self, topic: Topic[Any], robot: str) -> Topic[Any]:
        """Return a topic as the node refers to it; a shared node uses keys with robot names."""
        return of_robot(topic, robot) if self.row.shared else topic

    def need(self, taken: _Taken, giver: int | None) -> Need:
        given, rule = taken.input, taken.input.rule
        if giver is None and (rule == "due" or self.is_world):
            rule = "latest"  # nothing waits for a topic that no node of the scenario publishes
        return Need(
            self._known(given.topic, taken.robot),
            taken.on_bus,
            taken.robot,
            rule,
            giver,
            taken.period,
            int(self.is_world or given.before),
            given.revises,
        )


def _ordered(drafts: list[_Draft], givers: Mapping[str, _Draft]) -> list[_Draft]:
    """Sort drafts so that each follows those that it waits for; else keep the table's order.

    A node that uses a sample of the tick before comes before the giver of that sample.
    """
    awaited = {
        id(draft): []
        if draft.is_world  # it uses the outputs of the tick before
        else [
            giver
            for taken in draft.takes
            if taken.input.rule != "latest"
            and not taken.input.before
            and (giver := givers.get(taken.on_bus.key))
        ]
        for draft in drafts
    }
    for draft in drafts:
        for taken in draft.takes:
            if taken.input.before and (giver := givers.get(taken.on_bus.key)):
                awaited[id(giver)].append(draft)
    ordered: list[_Draft] = []
    left = sorted(drafts, key=lambda draft: not draft.is_world)
    while left:
        for draft in left:
            if not any(giver in left for giver in awaited[id(draft)]):
                ordered.append(draft)
                left.remove(draft)
                break
        else:
            raise ConfigError(_circle(left, awaited))
    return ordered


def _circle(left: list[_Draft], awaited: Mapping[int, list[_Draft]]) -> str:
    """Return a message that names nodes that wait for each other."""
    draft = left[0]
    seen: list[_Draft] = []
    while draft not in seen:
        seen.append(draft)
        draft = next(giver for giver in awaited[id(draft)] if giver in left)
    names = [one.row.name for one in (*seen[seen.index(draft) :], draft)]
    return f"{' waits for '.join(names)}: no step of theirs would ever be made"
