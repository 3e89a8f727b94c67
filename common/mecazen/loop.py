"""The loop: executes a plan, tick by tick. It is the only place where a tick happens.

The loop knows neither bus nor clock. Its driver (clock or worker) delivers samples of other
processes to the slots, decides how long to wait for them, and publishes the outputs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

from mecazen.keys import Topic
from mecazen.messages import Message
from mecazen.node import Inputs, Outputs, Tick
from mecazen.plan import Need, Turn
from mecazen.wire import NS_PER_S, Stamp

Put = Callable[[Message, Stamp], None]
Refuse = Callable[[Topic[Any], str], None]
AHEAD_AT_MOST = 10_000
"""Maximum number of samples that wait in a slot for their ticks."""


class Steps(Protocol):
    """The methods of a node that the loop calls."""

    def reset(self, seed: int) -> None:
        """Begin a run."""

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the outputs of a tick."""


class Slot:
    """An input of a turn: the newest message, and samples that wait for their ticks.

    Args:
        need: The input.
        is_remote: Whether other processes publish it.
        keeps_all: Whether every sample waits for its tick. Otherwise a newer sample replaces it.
    """

    __slots__ = (
        *("awaited", "count", "due", "fresh", "heard", "is_remote", "keeps_all", "late"),
        *("message", "need", "tick", "until", "waiting"),
    )

    def __init__(self, need: Need, *, is_remote: bool, keeps_all: bool) -> None:
        self.need = need
        self.is_remote = is_remote
        self.keeps_all = keeps_all
        self.late = 0
        """Number of steps that were made without the awaited sample."""
        self.count = 0
        """Number of samples received."""
        self.reset()

    def reset(self) -> None:
        """Begin a run."""
        self.message: Message | None = None
        self.fresh = False
        """Whether the message has arrived since the last step."""
        self.due: int | None = None
        """Tick of the step that the message was meant for; None for a message without a stamp."""
        self.tick = -1
        """Tick of the newest sample that a step can use."""
        self.heard = -1
        """Tick of the newest sample that has arrived, with or without a stamp."""
        self.until = -1
        """Newest tick whose samples the step uses."""
        self.awaited: int | None = None
        """Tick of the sample that the step waits for; None if it waits for no sample."""
        self.waiting: deque[tuple[Stamp, int, Message | None]] = deque(maxlen=AHEAD_AT_MOST)

    def give(self, message: Message, tick: int) -> None:
        """Store a message without a stamp, with the tick in which it arrived."""
        self.message, self.fresh, self.due, self.heard = message, True, None, tick
        self.count += 1

    def receive(self, message: Message | None, stamp: Stamp, tick: int) -> None:
        """Keep a sample of another process for its tick; None: that tick has no message."""
        if not self.keeps_all and self.waiting:
            self.waiting.pop()
        self.waiting.append((stamp, tick, message))
        self.heard = tick
        self.count += 1

    def open(self, k: int, last: int | None) -> None:
        """Prepare the step of tick `k`; `last` is the tick of the step before, if any."""
        self.until, self.awaited = k - self.need.lag, self.need.awaited_at(k, last)

    @property
    def lacks(self) -> bool:
        """Whether neither the awaited sample nor a later one has arrived."""
        waiting = self.waiting
        while waiting and waiting[0][1] <= self.until:
            _, tick, message = waiting.popleft()
            self.tick = max(self.tick, tick)
            if message is not None:
                self.message, self.fresh, self.due = message, True, tick + self.need.lag
        return self.awaited is not None and self.tick < self.awaited and not waiting


class Runner:
    """Runs a turn: holds its node, its slots, and the tick of its last step.

    Args:
        turn: The turn of the plan.
        node: The node that makes the steps.
        slots: One slot for each need of the turn.
        tick_ns: The control period [ns].
    """

    def __init__(self, turn: Turn, node: Steps, slots: Sequence[Slot], tick_ns: int) -> None:
        self.turn = turn
        self.node = node
        self.slots = tuple(slots)
        self.remote = tuple(slot for slot in slots if slot.is_remote)
        self.triggers = tuple(slot for slot in slots if slot.need.rule == "every")
        if turn.is_world:  # the world advances even if an answer is missing
            self.triggers = ()
        self.revising = tuple(slot for slot in slots if slot.need.revises)
        self.takers: dict[Topic[Any], tuple[Sequence[Slot], Put]] = {}
        """Slots in this process and the publishing function, by output."""
        self.promises: tuple[tuple[Topic[Any], int, Callable[[Stamp], None]], ...] = ()
        """Outputs that other processes wait for, each with the ticks between samples and a function
        that publishes the absence of a message."""
        self.missed = 0
        """Number of steps skipped because a sample of rule `every` did not arrive."""
        self.first_period_ns = 0 if turn.is_world else tick_ns
        self.last: int | None = None
        self.known_ns: dict[Topic[Any], int] = {}

    def reset(self, seed: int) -> None:
        """Begin a run, or restart within a run."""
        for slot in self.slots:
            slot.reset()
        self.last = None
        self.known_ns = {}
        self.node.reset(seed)

    def is_triggered(self, tick: int) -> bool:
        """Return whether all samples that trigger the step of a tick have arrived."""
        return all(slot.tick == tick for slot in self.triggers)


class Loop:
    """Runs the turns of a process in the order of the plan.

    Args:
        runners: The turns, in the order of the plan.
        tick_ns: The control period [ns].
        refuse: Function called with the topic and the reason when a node refuses a message.
    """

    def __init__(self, runners: Sequence[Runner], tick_ns: int, refuse: Refuse) -> None:
        self.runners = tuple(runners)
        self.tick_ns = tick_ns
        self._refuse = refuse
        self._revising = tuple(runner for runner in runners if runner.revising)
        self.stamp = Stamp(0, 0, 0)
        """Stamp of the newest tick."""

    def step(self, k: int, stamp: Stamp) -> Iterator[Slot]:
        """Run the turns of a tick; yield each slot that lacks a sample of another process.

        The caller waits for the sample or continues the iteration without it.
        """
        self.stamp = stamp
        for runner in self.runners:
            if not runner.turn.period or k % runner.turn.period:
                continue
            for slot in runner.remote:
                slot.open(k, runner.last)
                if slot.lacks:
                    yield slot
                    slot.late += slot.lacks
            if runner.is_triggered(k):
                self._take_turn(runner, k, stamp)
            else:
                self._publish(runner, k, stamp, {})

    def revise(self) -> None:
        """Repeat the last step of each turn for which a newer command has arrived."""
        for runner in self._revising:
            if runner.last is None:
                continue
            for slot in runner.revising:
                slot.open(runner.last, runner.last)
            if any(not slot.lacks and slot.fresh for slot in runner.revising):
                at = self.stamp._replace(time_ns=runner.last * self.tick_ns)
                self._take_turn(runner, runner.last, at)

    def _take_turn(self, runner: Runner, k: int, stamp: Stamp) -> None:
        """Make the step of a node and publish its outputs."""
        now_ns = stamp.time_ns
        samples: dict[Topic[Any], Message] = {}
        due_ns: dict[Topic[Any], int] = {}
        for slot in runner.slots:
            if slot.fresh:
                topic = slot.need.topic
                samples[topic] = slot.message  # type: ignore[assignment]  # it is fresh
                due_ns[topic] = now_ns if slot.due is None else slot.due * self.tick_ns
                slot.fresh = False
        if runner.last is None:
            period_ns = runner.first_period_ns
        else:
            period_ns = (k - runner.last) * self.tick_ns
            if k != runner.last:
                runner.missed += (k - runner.last) // runner.turn.period - 1
        runner.last = k
        inputs = Inputs(samples, runner.known_ns, now_ns, due_ns)
        outputs = runner.node.step(Tick(k, now_ns, period_ns / NS_PER_S), inputs)
        for topic, reason in inputs.refused:
            self._refuse(topic, reason)
        for topic in inputs.samples:
            runner.known_ns[topic] = due_ns[topic]
        self._publish(runner, k, stamp, outputs)

    def _publish(self, runner: Runner, k: int, stamp: Stamp, outputs: Outputs) -> None:
        """Hand outputs to the slots in this process and publish them to other processes."""
        for topic, message in outputs.items():
            slots, put = runner.takers[topic]
            for slot in slots:
                slot.message, slot.tick, slot.fresh = message, k, True
                slot.heard = k
                slot.count += 1
            put(message, stamp)
        for topic, period, put_nothing in runner.promises:
            if k % period == 0 and topic not in outputs:
                put_nothing(stamp)
