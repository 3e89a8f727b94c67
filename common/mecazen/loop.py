"""The loop: takes the turns of a process, tick by tick. It is the only place where a tick happens.

The loop knows neither bus nor clock. Its driver (clock or worker) delivers samples of other
processes to the slots, and decides how long to wait for them.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from typing import Any

from mecazen.config import Scenario
from mecazen.errors import ConfigError, NodeError, RefusedError, explaining
from mecazen.graph import Graph
from mecazen.keys import CLOCK, Topic, of_robot
from mecazen.messages import Message
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.robots import join_key, seed_of
from mecazen.row import Input, Row
from mecazen.wire import NS_PER_S, Stamp, decode, encode

AHEAD_AT_MOST = 10_000
"""Maximum number of samples that wait in a slot for their ticks."""

_PLAIN = nullcontext()


class Slot:
    """An input of a turn: the newest message, and samples that wait for their ticks."""

    def __init__(self, topic: Topic[Any], on_bus: Topic[Any], row_input: Input) -> None:
        self.topic, self.on_bus = topic, on_bus
        """The topic as the node refers to it, and the topic with its full key."""
        self.rule = row_input.rule
        """The rule that applies in this run."""
        self.revises = row_input.revises
        """Whether a sample that arrives after the step of its tick repeats that step."""
        self.lag = int(row_input.before)
        """Number of ticks between a sample and the step that uses it."""
        self.giver: Turn | None = None
        """The turn that publishes it; None if only other programs do."""
        self.period = 1
        """Number of ticks from one sample to the next."""
        self.is_remote = True
        """Whether another process publishes it."""
        self.keeps_all = False
        """Whether every sample waits for its tick; otherwise a newer sample replaces it."""
        self.late = 0
        """Number of steps that were made without the awaited sample."""
        self.count = 0
        """Number of samples received."""
        self.reset()

    def reset(self) -> None:
        """Begin a run."""
        self.message: Message | None = None
        self.is_fresh = False
        """Whether the message has arrived since the last step."""
        self.due: int | None = None
        """Tick of the step that the message was meant for; None for a message without a stamp."""
        self.tick = -1
        """Tick of the newest sample that a step can use."""
        self.newest = -1
        """Tick of the newest sample that has arrived, with or without a stamp."""
        self.awaited: int | None = None
        """Tick of the sample that the step waits for; None if it waits for no sample."""
        self.waiting: deque[tuple[Stamp, int, Message | None]] = deque(maxlen=AHEAD_AT_MOST)

    def hand_over(self, message: Message, tick: int) -> None:
        """Store the message of a turn of this process."""
        self.message, self.is_fresh, self.due = message, True, tick + self.lag
        self.tick = self.newest = tick
        self.count += 1

    def give(self, message: Message, tick: int) -> None:
        """Store a message without a stamp, with the tick in which it arrived."""
        self.message, self.is_fresh, self.due = message, True, None
        self.note(tick)

    def note(self, tick: int) -> None:
        """Count a message that arrived in a tick."""
        self.newest = tick
        self.count += 1

    def receive(self, message: Message | None, stamp: Stamp, tick: int) -> None:
        """Keep a sample of another process for its tick; None: that tick has no message."""
        if not self.keeps_all and self.waiting:
            self.waiting.pop()
        self.waiting.append((stamp, tick, message))
        self.newest = tick
        self.count += 1

    def expect(self, k: int, last: int | None) -> None:
        """Determine the sample that the step of tick `k` waits for: the newest that is due.

        `last` is the tick of the turn's last step.
        """
        self.awaited, newest = None, k - self.lag
        if self.rule != "latest" and newest >= 0:
            due = newest - newest % self.period
            before = newest - 1 if last is None else last - self.lag
            self.awaited = due if due > before else None

    @property
    def is_missing(self) -> bool:
        """Whether neither the awaited sample nor a later one has arrived."""
        awaited = self.awaited
        if awaited is None or self.tick >= awaited:
            return False
        return all(tick < awaited for _, tick, _ in self.waiting)

    def take(self, k: int) -> None:
        """Take the samples that the step of tick `k` uses."""
        newest, waiting = k - self.lag, self.waiting
        while waiting and waiting[0][1] <= newest:
            _, tick, message = waiting.popleft()
            self.tick = max(self.tick, tick)
            if message is not None:
                self.message, self.is_fresh, self.due = message, True, tick + self.lag


@dataclass
class Output:
    """An output of a turn."""

    on_bus: Topic[Any]
    """The topic with its full key."""
    period: int
    """Number of ticks from one sample to the next."""
    slots: Sequence[Slot] = ()
    """The inputs in this process that take it."""
    put: Callable[[Message, Stamp], None] = lambda *_: None
    """Publishes a sample to other processes and programs."""
    put_nothing: Callable[[Stamp], None] | None = None
    """Publishes the absence of a sample, if other processes wait for it."""


class Turn:
    """A node of one robot or of all robots, its inputs and outputs, and its place in a tick."""

    def __init__(self, row: Row, robot: str, scenario: Scenario, graph: Graph) -> None:
        self.row, self.robot = row, robot
        names = scenario.names if row.shared else (robot,)
        part = scenario.of(robot) if robot else scenario
        is_lockstep = scenario.sim.mode == "lockstep"

        def known(topic: Topic[Any], name: str) -> Topic[Any]:
            """Return a topic as the node refers to it."""
            return of_robot(topic, name) if row.shared else topic

        def period(topic: Topic[Any]) -> int:
            return part.ticks_per(graph.rate(topic.key))

        for rate in row.rates.values():
            part.ticks_per(rate)  # refuses a rate that does not divide the tick rate
        self.slots: list[Slot] = []
        for i in row.inputs:
            for name in ("",) if i.topic.shared or i.topic is CLOCK else names:
                slot = Slot(known(i.topic, name), of_robot(i.topic, name), i)
                slot.period = period(i.topic)
                has_giver = not i.topic.by_hand and graph.giver(i.topic.key) is not None
                if i.rule == "latest" and is_lockstep and has_giver:
                    slot.rule = "due"  # so that results do not depend on the order of arrival
                self.slots.append(slot)
        self.outputs: dict[Topic[Any], Output] = {}
        for topic in row.outputs:
            clocks = ("",) if topic is CLOCK else ()  # also outside the robots' namespaces
            for name in dict.fromkeys((*clocks, *names)):
                self.outputs[known(topic, name)] = Output(of_robot(topic, name), period(topic))
        triggers = [slot.period for slot in self.slots if slot.rule == "every"]
        self.period = 1 if row.owns_time else math.lcm(*triggers) if triggers else 0
        """Number of ticks from one step to the next; 0: the node makes no steps."""
        self.node: Node | None = None
        """The node, if it is in this process."""
        self.is_user = row.name in scenario.programs
        """Whether a user's class computes it."""
        self.remote: tuple[Slot, ...] = ()
        """The slots that other processes fill."""
        self._is_open = False
        """Whether the node has begun a run and is not closed."""
        self.missed = 0
        """Number of steps skipped because a sample of rule `every` did not arrive."""
        self.last: int | None = None
        """Tick of the last step in this run."""
        self.known_ns: dict[Topic[Any], int] = {}
        """Time of the newest message that steps have used [ns]."""

    @property
    def service(self) -> str:
        """The service's name, preceded by the robot's name if there are several robots."""
        return join_key(self.row.part_of, self.robot)

    def make(self, kind: type[Node], scenario: Scenario) -> None:
        """Make the node, with the part of the scenario that belongs to its robot."""
        self.scenario = scenario.of(self.robot) if self.robot else scenario
        with self.calling():
            self.node = kind(self.scenario)
        self.triggers = tuple(slot for slot in self.slots if slot.rule == "every")
        self.revising = tuple(slot for slot in self.slots if slot.revises)

    @property
    def running(self) -> Node:
        """The node of a turn of this process."""
        assert self.node is not None
        return self.node

    def calling(self) -> AbstractContextManager[None]:
        """Return the context in which the node's methods are called: it explains users' errors."""
        return explaining(self.row.name) if self.is_user else _PLAIN

    def reset(self, seed: int) -> None:
        """Begin a run of a seed, or restart the node within a run."""
        for slot in self.slots:
            slot.reset()
        self.last = None
        self.known_ns = {}
        with self.calling():
            self.running.reset(seed_of(seed, self.robot))
        self._is_open = True

    def close(self) -> None:
        """Close the node, unless it has never begun a run or is closed."""
        if self._is_open:
            self._is_open = False
            with self.calling():
                self.running.close()

    def configure(self, scenario: Scenario, seed: int) -> None:
        """Apply a scenario with changed parameters from the next step on."""
        part = scenario.of(self.robot) if self.robot else scenario
        if part != self.scenario:
            self.scenario = part
            with self.calling():
                self.running.configure(part)
        if self.last is None:
            with self.calling():
                self.running.reset(seed_of(seed, self.robot))

    def is_triggered(self, k: int) -> bool:
        """Return whether all samples that trigger the step of a tick have arrived."""
        for slot in self.triggers:  # noqa: SIM110  # `all` takes three times as long
            if slot.tick != k:
                return False
        return True

    def depth(self) -> int:
        """Return how many turns of a tick, one after the other, this turn waits for."""
        waits = [s.giver for s in self.slots if s.giver and not s.lag and s.rule != "latest"]
        return max((1 + giver.depth() for giver in waits), default=0)

    def check(self, outputs: object) -> None:
        """Refuse outputs that do not match the row, or that a receiver would refuse.

        Raises:
            NodeError: There is such an output.
        """
        name = self.row.name
        if not isinstance(outputs, Mapping):
            kind = type(outputs).__name__
            raise NodeError(f"{name}: step must return a mapping of topics to messages, got {kind}")
        for topic, message in outputs.items():
            if not isinstance(topic, Topic):
                raise NodeError(f"{name}: step returns {topic!r:.80}, which is no topic")
            if type(message) is not topic.type:
                raise NodeError(
                    f"{name}: step returns {topic.key} as {type(message).__name__}; it must "
                    f"be {topic.type.__name__} of mecazen.messages"
                )
            if topic not in self.outputs:
                raise NodeError(f"{name} gives {topic.key}, which is not in its row")
            payload = encode(message)
            if len(payload) > topic.max_bytes:
                raise NodeError(
                    f"{name} gives {topic.key} of {len(payload)} bytes, at most {topic.max_bytes}"
                )
            try:
                decode(payload, topic.type)
            except RefusedError as refusal:
                raise NodeError(f"{name} gives {topic.key}: {refusal}") from None


def turns_of(scenario: Scenario, graph: Graph) -> tuple[Turn, ...]:
    """Return the turns of a scenario, in the order in which they are taken within a tick.

    Every process computes the same order. So no two of them wait for each other.

    Raises:
        ConfigError: A rate does not divide the tick rate, or nodes wait for each other.
    """
    turns = [
        Turn(row, robot, scenario, graph)
        for row in graph.rows
        if not row.observes
        for robot in (("",) if row.shared else scenario.names)
    ]
    givers = {output.on_bus.key: turn for turn in turns for output in turn.outputs.values()}
    order: TopologicalSorter[Turn] = TopologicalSorter(dict.fromkeys(turns, ()))
    for turn in turns:
        for slot in turn.slots:
            slot.giver = None if slot.topic.by_hand else givers.get(slot.on_bus.key)
            if slot.giver is None:
                if slot.rule == "due":
                    slot.rule = "latest"  # nothing waits for a topic that no node publishes
            elif slot.lag:
                order.add(slot.giver, turn)  # it uses the sample of the tick before
            elif slot.rule != "latest":
                order.add(turn, slot.giver)
    try:
        return tuple(order.static_order())
    except CycleError as error:
        circle = " waits for ".join(turn.row.name for turn in reversed(error.args[1]))
        raise ConfigError(f"{circle}: no step of theirs would ever be made") from None


def awaited_services(turns: Iterable[Turn]) -> frozenset[str]:
    """Return the services that the world waits for, directly or not, and its own service."""
    turns = tuple(turns)
    worlds = {turn.service for turn in turns if turn.row.owns_time}
    waiting = [turn for turn in turns if turn.service in worlds]
    awaited: set[Turn] = set()
    while waiting:
        turn = waiting.pop()
        if turn not in awaited:
            awaited.add(turn)
            waiting += [slot.giver for slot in turn.slots if slot.giver and slot.rule != "latest"]
    return frozenset(turn.service for turn in awaited)


class Loop:
    """Takes the turns of a process.

    Args:
        turns: The turns, in the order of `turns_of`, with their nodes.
        tick_ns: The control period [ns].
        refuse: Function called with the topic and the reason when a node refuses a message.
    """

    def __init__(
        self, turns: Sequence[Turn], tick_ns: int, refuse: Callable[[Topic[Any], str], None]
    ) -> None:
        self.turns = tuple(turns)
        self.tick_ns = tick_ns
        self.stamp = Stamp(0, 0, 0)
        """Stamp of the newest tick."""
        self._next = 0
        """The index of the turn to be taken next in the tick in progress."""
        self._refuse = refuse
        self._revising = tuple(turn for turn in turns if turn.revising)

    def begin(self, stamp: Stamp) -> None:
        """Begin a run, in which no tick is in progress."""
        self.stamp, self._next = stamp, 0

    def step(self, k: int, stamp: Stamp, wait: Callable[[Slot], bool]) -> bool:
        """Take the turns of a tick.

        Args:
            k: The number of the tick.
            stamp: The stamp of the outputs.
            wait: Function that waits for a missing sample; True: the turn is taken, even if it is
                still missing.

        Returns:
            False if `wait` has returned False; the next call continues with the turn that lacks it.
        """
        self.stamp = stamp
        while self._next < len(self.turns):
            turn = self.turns[self._next]
            if turn.period and k % turn.period == 0:
                for slot in turn.remote:
                    slot.expect(k, turn.last)
                    if slot.is_missing:
                        if not wait(slot):
                            return False
                        slot.late += slot.is_missing
                    slot.take(k)
                if turn.is_triggered(k):
                    self._step(turn, k, stamp)
                else:
                    self._publish(turn, k, stamp, {})
            self._next += 1
        self._next = 0
        return True

    def revise(self) -> None:
        """Repeat the last step of each turn for which a newer command has arrived."""
        for turn in self._revising:
            if turn.last is None:
                continue
            for slot in turn.revising:
                slot.take(turn.last)
            if any(slot.is_fresh for slot in turn.revising):
                stamp = self.stamp._replace(time_ns=turn.last * self.tick_ns)
                self._step(turn, turn.last, stamp)

    def _step(self, turn: Turn, k: int, stamp: Stamp) -> None:
        samples: dict[Topic[Any], Message] = {}
        due_ns: dict[Topic[Any], int] = {}
        for slot in turn.slots:
            if slot.is_fresh:
                samples[slot.topic] = slot.message  # type: ignore[assignment]  # it is fresh
                due_ns[slot.topic] = (k if slot.due is None else slot.due) * self.tick_ns
                slot.is_fresh = False
        ticks = 1 if turn.last is None else k - turn.last
        if turn.last is not None and ticks:
            turn.missed += ticks // turn.period - 1
        turn.last = k
        inputs = Inputs(samples, turn.known_ns, stamp.time_ns, due_ns)
        tick = Tick(k, stamp.time_ns, ticks * self.tick_ns / NS_PER_S)
        if turn.is_user:
            with turn.calling():
                outputs = turn.running.step(tick, inputs)
            turn.check(outputs)
        else:
            outputs = turn.running.step(tick, inputs)
        for topic, reason in inputs.refused:
            self._refuse(topic, reason)
        for topic in inputs.samples:
            turn.known_ns[topic] = due_ns[topic]
        self._publish(turn, k, stamp, outputs)

    def _publish(self, turn: Turn, k: int, stamp: Stamp, outputs: Outputs) -> None:
        for topic, message in outputs.items():
            output = turn.outputs[topic]
            for slot in output.slots:
                slot.hand_over(message, k)
            output.put(message, stamp)
        for topic, output in turn.outputs.items():
            if output.put_nothing and k % output.period == 0 and topic not in outputs:
                output.put_nothing(stamp)
