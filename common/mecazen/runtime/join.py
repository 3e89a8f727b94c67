"""Which samples make up a step of a node."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from mecazen.graph import Input
from mecazen.keys import Topic
from mecazen.messages import Message
from mecazen.wire import Stamp

AHEAD_AT_MOST = 10_000
"""So many samples of a topic are held back at most: far more than one sender gets ahead by."""


class Joined(NamedTuple):
    """What a step is made with."""

    stamp: Stamp
    samples: Mapping[Topic[Any], Message]
    again: bool = False
    """Whether the step of this tick has been done before."""


class Join:
    """Collects the samples of a node's inputs until they make up a step.

    A tick is open from the arrival of its samples of rule "every" until what is due in it has
    come. Where the next tick comes first, the open one is closed with what there is; or, where
    the join is `whole`, the next is held back, so the steps don't depend on whose samples come
    first.

    Args:
        inputs: The node's inputs, as `Graph.resolved` has them.
        periods_ns: Of inputs of rule "due": from one sample to the next [ns].
        whole: Whether every sample comes, and each sender's in their order, as in lockstep.
    """

    def __init__(
        self,
        inputs: Iterable[Input],
        periods_ns: Mapping[Topic[Any], int],
        *,
        whole: bool = False,
    ) -> None:
        inputs = tuple(inputs)
        self._whole = whole
        self._triggers = tuple(i.topic for i in inputs if i.rule == "every")
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
        awaited = (*self._due, *self._triggers)
        # one topic alone is never ahead of another
        holds = self._whole and self._triggers and len(awaited) > 1
        self._held: dict[Topic[Any], deque[tuple[Message, Stamp]]] = {
            topic: deque(maxlen=AHEAD_AT_MOST) for topic in (awaited if holds else ())
        }

    def awaits(self, topic: Topic[Any]) -> bool:
        """Return whether steps wait for a topic's samples."""
        return topic in self._due or topic in self._triggers

    def put(self, topic: Topic[Any], message: Message, stamp: Stamp | None) -> Iterator[Joined]:
        """Take a sample of this run; yield the steps that can be made now."""
        last_ns = -1 if self._last is None else self._last.time_ns
        if stamp is None or topic not in self._held or stamp.time_ns <= last_ns:
            yield from self._put(topic, message, stamp)
            return
        self._held[topic].append((message, stamp))
        while (tick_ns := self._next_whole_ns()) is not None:
            # what is due comes before what makes the step
            for given, held in self._held.items():
                while held and held[0][1].time_ns <= tick_ns:
                    yield from self._put(given, *held.popleft())

    def _next_whole_ns(self) -> int | None:
        """Return the next tick [ns] of which all has come; None: it is still awaited."""
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

    def _put(self, topic: Topic[Any], message: Message, stamp: Stamp | None) -> Iterator[Joined]:
        if topic in self._triggers:
            if stamp is None or stamp.time_ns <= self._newest_ns.get(topic, -1):
                return
            if self._open is not None:
                yield self._close()
            self._newest_ns[topic] = stamp.time_ns
            self._new[topic] = message
            if any(self._newest_ns.get(other) != stamp.time_ns for other in self._triggers):
                return
            self._open = stamp
            if not self._missing(stamp):
                yield self._close()
            return
        self._new[topic] = message
        if stamp is not None:
            self._newest_ns[topic] = max(stamp.time_ns, self._newest_ns.get(topic, -1))
        yield from self._go_on(topic, stamp)

    def _go_on(self, topic: Topic[Any], stamp: Stamp | None) -> Iterator[Joined]:
        last = self._last
        if self._open is not None:
            if topic in self._due and not self._missing(self._open):
                yield self._close()
        elif (
            last is not None
            and topic in self._revising
            # one that is ahead of its tick waits for it
            and (stamp is None or stamp.time_ns <= last.time_ns)
        ):
            yield self._take(last, again=True)

    def _missing(self, stamp: Stamp) -> list[Topic[Any]]:
        """Return the topics of samples that are due since the last step and have not come."""
        last_ns = stamp.time_ns - 1 if self._last is None else self._last.time_ns
        missing = []
        for topic, period_ns in self._due.items():
            due_ns = stamp.time_ns - stamp.time_ns % period_ns
            held = self._held.get(topic)
            newest_ns = held[-1][1].time_ns if held else self._newest_ns.get(topic, -1)
            if last_ns < due_ns and newest_ns < due_ns:
                missing.append(topic)
        return missing

    def _close(self) -> Joined:
        """Return the step of the open tick."""
        stamp = self._open
        assert stamp is not None
        for topic in self._missing(stamp):
            self.late[topic.key] += 1
        self._open = None
        if self._last is not None:
            passed_ns = stamp.time_ns - self._last.time_ns
            self._period_ns = min(self._period_ns or passed_ns, passed_ns)
            self.missed_ticks += passed_ns // self._period_ns - 1
        self._last = stamp
        return self._take(stamp)

    def _take(self, stamp: Stamp, *, again: bool = False) -> Joined:
        samples, self._new = self._new, {}
        return Joined(stamp, samples, again)
