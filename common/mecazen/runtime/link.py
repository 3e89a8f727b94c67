"""One robot of a world on the bus: its state goes out, the answers to a tick come in."""

from __future__ import annotations

from functools import partial
from typing import Any

from mecazen.bus import Reply
from mecazen.graph import Graph
from mecazen.keys import CLOCK, Call, Topic
from mecazen.messages import Clock, Message
from mecazen.node import Inputs, Outputs, World
from mecazen.robots import join_key, seed_of
from mecazen.row import Row
from mecazen.runtime.participant import Participant
from mecazen.wire import NS_PER_S, RefusedError, Stamp

Answer = tuple[str, Topic[Any]]
"""What is awaited in a tick: of which robot, on which topic."""


class Link:
    """A robot's topics and queries.

    Args:
        name: The robot's; of a single one, empty.
        clock: Whose runs and ticks it takes part in.
        row: What the world takes and gives.
        graph: The nodes of the scenario: inputs that one of them gives are awaited when due.
        world: Whose robot it is.
        pending: The answers that are still to come, of all links.
    """

    def __init__(
        self,
        name: str,
        clock: Participant,
        row: Row,
        graph: Graph,
        world: World,
        pending: set[Answer],
    ) -> None:
        self.name = name
        self.bus = clock.bus.namespaced(name)
        lockstep = clock.scenario.sim.mode == "lockstep"
        # of several robots the first one takes what they share
        taken = [i for i in row.inputs if not i.topic.shared or name == clock.scenario.names[0]]
        self._givers = {
            i.topic: giver.part_of
            for i in taken
            if i.rule != "latest" and (giver := graph.giver(i.topic.key)) is not None
        }
        self._periods_ns = dict.fromkeys(self._givers, clock.tick_ns)
        for i in taken:
            if i.rule == "due":
                ticks = clock.scenario.ticks_per(graph.rate(i.topic.key))
                self._periods_ns[i.topic] = ticks * clock.tick_ns
        self._pending = pending
        self._clock = self.bus.publisher(CLOCK)
        self._publishers = {topic: self.bus.publisher(topic) for topic in row.outputs}
        self._samples: dict[Topic[Any], Message] = {}
        for given in taken:
            topic = given.topic
            only_stamped = lockstep and topic in self._givers
            clock.subscribe(
                topic, partial(self._take, topic, only_stamped=only_stamped), robot=name
            )
        for call in row.calls:
            self.bus.serve(call, partial(self._answer, world, call))
        for prefix, files in world.files(name).items():
            self.bus.serve_files(prefix, files)

    def reset(self, stamp: Stamp) -> None:
        """Begin a run at the tick of `stamp`."""
        self._seed = seed_of(stamp.seed, self.name)
        self._known_ns: dict[Topic[Any], int] = {}
        self.begin_tick(stamp)

    def begin_tick(self, stamp: Stamp) -> None:
        """Await the answers to a tick."""
        self.stamp = Stamp(stamp.time_ns, stamp.run, self._seed, stamp.revision)
        self._samples = {}
        self._pending.update(
            (self.name, topic)
            for topic in self._givers
            if stamp.time_ns % self._periods_ns[topic] == 0
        )

    @property
    def awaits(self) -> bool:
        """Whether any node of the scenario answers its ticks."""
        return bool(self._givers)

    @property
    def awaited(self) -> list[str]:
        """The services whose answers are still to come, by their names beside other robots'."""
        return [join_key(part, self.name) for part in sorted(self._missing())]

    @property
    def gone(self) -> list[str]:
        """Those of them that are not alive."""
        gone = self._missing() - self.bus.presence.names
        return [join_key(part, self.name) for part in sorted(gone)]

    def _missing(self) -> set[str]:
        return {self._givers[topic] for name, topic in self._pending if name == self.name}

    def publish(self, outputs: Outputs) -> None:
        """Publish the state of the tick."""
        self._clock.put(Clock(clock=self.stamp.time), self.stamp)
        for topic, message in outputs.items():
            self._publishers[topic].put(message, self.stamp)

    def inputs(self) -> Inputs:
        """Return what has come in this tick."""
        now_ns = self.stamp.time_ns
        ages_s = {topic: (now_ns - at_ns) / NS_PER_S for topic, at_ns in self._known_ns.items()}
        return Inputs(self._samples, ages_s)

    def note(self, inputs: Inputs) -> None:
        """Take note of which of these the world could use."""
        for topic, reason in inputs.refused:
            self.bus.refuse(topic.key, reason)
        for topic in self._samples:
            if inputs.get(topic) is not None:
                self._known_ns[topic] = self.stamp.time_ns

    def _take(
        self, topic: Topic[Any], message: Message, stamp: Stamp | None, *, only_stamped: bool
    ) -> None:
        if stamp is None and only_stamped:
            return
        self._samples[topic] = message
        if stamp is not None and stamp.time_ns == self.stamp.time_ns:
            self._pending.discard((self.name, topic))

    def _answer(
        self, world: World, call: Call[Any, Any], request: Message, reply: Reply[Any]
    ) -> None:
        try:
            reply.answer(world.answer(call, request, self.name))
        except RefusedError as refusal:
            reply.refuse(str(refusal))
