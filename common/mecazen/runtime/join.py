"""Which samples make up a step of a node."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from mecazen.keys import Topic
from mecazen.messages import Message
from mecazen.row import Input
from mecazen.wire import Stamp

AHEAD_AT_MOST = 10_000
"""So many samples of a topic are held back at most: far more than one sender gets ahead by."""


class Joined(NamedTuple):
    """What a step is made with."""

    stamp: Stamp
    samples: Mapping[Topic[Any], Message]


class Join:
    """Collects the samples of a node's inputs until they make up a step.

    A tick is open from the arrival of its samples of rule "every" until what is due in it has
    come. Where the next tick comes first, the open one is closed with what there is.

    Args:
        inputs: The node's inputs, as `Graph.resolved` has them.
        periods_ns: Of inputs of rule "due": from one sample to the next [ns].
    """

    def __init__(self, inputs: Iterable[Input], periods_ns: Mapping[Topic[Any], int]) -> None:
        inputs = tuple(inputs)
        self._triggers = tuple(i.topic for i in inputs if i.rule == "every")
        self._only_trigger = self._triggers[0] if len(self._triggers) == 1 else None
        self._due = {i.topic: periods_ns[i.topic] for i in inputs if i.rule == "due"}
        self._revising = {i.topic for i in inputs if i.revises}
        self.late: dict[str, int] = {i.topic.key: 0 for i in inputs if i.rule == "due"}
        """Due samples that came after their tick was closed, by key."""
        self.missed_ticks = 0
        """Ticks of which no step was made, since their samples never came."""
        self.reset()

    def reset(self) -> None:
        """Begin a run."""
        self._new: dict[Topic[Any], Message] = {}
        self._newest_ns: dict[Topic[Any], int] = {}
        self._open: Stamp | None = None
        self._last: Stamp | None = None
        self._period_ns = 0

    def awaits(self, topic: Topic[Any]) -> bool:
        """Return whether steps wait for a topic's samples."""
        return topic in self._due or topic in self._triggers

    def put(self, topic: Topic[Any], message: Message, stamp: Stamp | None) -> Sequence[Joined]:
        """Take a sample of this run; return the steps that can be made now."""
        if topic not in self._triggers:
            self._new[topic] = message
            if stamp is not None:
                self._newest_ns[topic] = max(stamp.time_ns, self._newest_ns.get(topic, -1))
            return self._go_on(topic, stamp)
        if stamp is None or stamp.time_ns <= self._newest_ns.get(topic, -1):
            return ()
        closed = () if self._open is None else (self._close(self._missing(self._open)),)
        self._newest_ns[topic] = stamp.time_ns
        self._new[topic] = message
        if topic is not self._only_trigger and any(
            self._newest_ns.get(other) != stamp.time_ns for other in self._triggers
        ):
            return closed
        self._open = stamp
        if self._due and self._missing(stamp):
            return closed
        return (*closed, self._close())

    def _go_on(self, topic: Topic[Any], stamp: Stamp | None) -> Sequence[Joined]:
        last = self._last
        if self._open is not None:
            if topic in self._due and not self._missing(self._open):
                return (self._close(),)
        elif (
            last is not None
            and topic in self._revising
            # one that is ahead of its tick waits for it
            and (stamp is None or stamp.time_ns <= last.time_ns)
        ):
            return (self._take(last),)
        return ()

    def _missing(self, stamp: Stamp) -> list[Topic[Any]]:
        """Return the topics of samples that are due since the last step and have not come."""
        last_ns = stamp.time_ns - 1 if self._last is None else self._last.time_ns
        missing = []
        for topic, period_ns in self._due.items():
            due_ns = stamp.time_ns - stamp.time_ns % period_ns
            if last_ns < due_ns and self._newest_of(topic) < due_ns:
                missing.append(topic)
        return missing

    def _newest_of(self, topic: Topic[Any]) -> int:
        """Return the time of a topic's newest sample [ns]; -1: none has come."""
        return self._newest_ns.get(topic, -1)

    def _close(self, missing: Sequence[Topic[Any]] = ()) -> Joined:
        """Return the step of the open tick, without the samples that are `missing`."""
        stamp = self._open
        assert stamp is not None
        for topic in missing:
            self.late[topic.key] += 1
        self._open = None
        if self._last is not None:
            passed_ns = stamp.time_ns - self._last.time_ns
            if passed_ns != self._period_ns:
                self._period_ns = min(self._period_ns or passed_ns, passed_ns)
                self.missed_ticks += passed_ns // self._period_ns - 1
        self._last = stamp
        return self._take(stamp)

    def _take(self, stamp: Stamp) -> Joined:
        samples, self._new = self._new, {}
        return Joined(stamp, samples)


class WholeJoin(Join):
    """A join of which every sample comes, and each sender's in their order, as in lockstep.

    Where the next tick comes before the open one is whole, it is held back, so the steps don't
    depend on whose samples come first.
    """

    def reset(self) -> None:
        """Begin a run."""
        super().reset()
        self._holding = False
        """Whether any sample is held back."""
        self._held: dict[Topic[Any], deque[tuple[Message, Stamp]]] = {
            topic: deque(maxlen=AHEAD_AT_MOST) for topic in (*self._due, *self._triggers)
        }

    def put(self, topic: Topic[Any], message: Message, stamp: Stamp | None) -> Sequence[Joined]:
        """Take a sample of this run; return the steps that can be made now."""
        held = self._held.get(topic)
        if held is None or stamp is None or (not held and self._is_next(topic, stamp)):
            joined = super().put(topic, message, stamp)
            return joined if not self._holding else (*joined, *self._release())
        held.append((message, stamp))
        self._holding = True
        return self._release()

    def _is_next(self, topic: Topic[Any], stamp: Stamp) -> bool:
        """Return whether a sample is of the tick whose turn it is: most are, and wait for none."""
        if self._last is not None and stamp.time_ns <= self._last.time_ns:
            return True
        if self._open is None:
            return topic is self._only_trigger and not self._holding
        return topic in self._due and stamp.time_ns <= self._open.time_ns

    def _release(self) -> list[Joined]:
        """Take what was held back of each tick of which all has come."""
        steps: list[Joined] = []
        while (tick_ns := self._next_whole_ns()) is not None:
            # what is due comes before what makes the step
            for given, held in self._held.items():
                while held and held[0][1].time_ns <= tick_ns:
                    steps += super().put(given, *held.popleft())
        self._holding = any(self._held.values())
        return steps

    def _next_whole_ns(self) -> int | None:
        """Return the next tick [ns] of which all has come; None: it is still awaited."""
        if self._open is not None and self._missing(self._open):
            return None
        heads = [self._held[topic] for topic in self._triggers]
        while all(heads):
            stamps = [held[0][1] for held in heads]
            newest = max(stamps, key=lambda stamp: stamp.time_ns)
            behind = [h for h in heads if h[0][1].time_ns < newest.time_ns]
            if not behind:
                return None if self._missing(newest) else newest.time_ns
            for held in behind:
                held.popleft()
        return None

    def _newest_of(self, topic: Topic[Any]) -> int:
        held = self._held.get(topic)
        return held[-1][1].time_ns if held else super()._newest_of(topic)


def make_join(
    inputs: Iterable[Input], periods_ns: Mapping[Topic[Any], int], *, whole: bool
) -> Join:
    """Return the join of a node; see `WholeJoin` for what is `whole`."""
    inputs = tuple(inputs)
    awaited = [i for i in inputs if i.rule != "latest"]
    triggered = any(i.rule == "every" for i in inputs)
    # one topic alone is never ahead of another
    kind = WholeJoin if whole and triggered and len(awaited) > 1 else Join
    return kind(inputs, periods_ns)
