"""The nodes of a service on a bus: what the runtime does for every node, once."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from mecazen import keys
from mecazen.bus import Bus, Publisher, Reply
from mecazen.config import Scenario
from mecazen.errors import ConfigError
from mecazen.graph import Graph
from mecazen.keys import CLOCK, Call, Topic
from mecazen.messages import Message, Parameters
from mecazen.node import Inputs, Node, Tick
from mecazen.parameters import settings_of
from mecazen.runtime.join import Joined, make_join
from mecazen.runtime.own import check_outputs, guarded
from mecazen.runtime.participant import Participant
from mecazen.wire import NS_PER_S, RefusedError, Stamp


class Service(Participant):
    """The nodes of a service of one robot.

    Args:
        name: The service.
        bus: In the namespace of the robot.
        scenario: As the robot sees it.
        graph: The nodes of the scenario.
        kinds: The classes of the service's nodes, by the nodes' names.

    Raises:
        ConfigError: The scenario does not suit a node.
    """

    def __init__(
        self,
        name: str,
        bus: Bus,
        scenario: Scenario,
        graph: Graph,
        kinds: Mapping[str, type[Node]],
    ) -> None:
        super().__init__(name, bus, scenario)
        self.revision = 0
        """Of the parameters: how often they have been changed, as far as is known here."""
        self._forget_changes: Callable[[], None] = lambda: None
        self.nodes = [_Stepped(part, kind, self, graph) for part, kind in kinds.items()]
        if scenario.robots:
            self._of_robots = {i.topic for node in self.nodes for i in node.row.inputs} - {CLOCK}
        takers: dict[Topic[Any], list[_Stepped]] = {}
        for node in self.nodes:
            for given in node.row.inputs:
                takers.setdefault(given.topic, []).append(node)
            for call in node.row.calls:
                bus.serve(call, partial(self._answer, node, call))
        lockstep = scenario.sim.mode == "lockstep"
        for topic, nodes in takers.items():
            # in lockstep only the node of the graph is heard on its topics
            only_stamped = lockstep and graph.giver(topic.key) is not None
            deliver = _deliver(topic, nodes, only_stamped=only_stamped)
            # so that a node that nobody waits for makes every step, however slow it is
            every = only_stamped and any(node.join.awaits(topic) for node in nodes)
            self.subscribe(nodes[0].row.on_bus(topic), deliver, every=every)
        self._resets_with = {part for node in self.nodes for part in node.row.resets_with}
        bus.presence.on_return.append(self._on_return)
        self.reset(scenario.seed)

    def take_changes(self, changed: Callable[[dict[str, str]], Scenario]) -> None:
        """Take changes of parameters, with what makes the service's scenario of all of them.

        No step is made before those are known that count in its tick.
        """
        started = self.scenario

        def take(message: Parameters, stamp: Stamp | None) -> None:
            if stamp is None or message.revision <= self.revision:
                return
            try:
                self._go_on_with(changed(settings_of(message)), message.revision, stamp)
            except ConfigError as error:
                self.bus.refuse(keys.PARAMETERS.key, str(error))

        def forget() -> None:
            self._go_on_with(started, 0, self.stamp)

        self._forget_changes = forget
        self.bus.subscribe(keys.PARAMETERS, take, every=True)

    def _go_on_with(self, scenario: Scenario, revision: int, stamp: Stamp) -> None:
        self.revision = revision
        if scenario != self.scenario:
            self.scenario = scenario
            for node in self.nodes:
                node.changes.append((stamp._replace(revision=revision), scenario))
        for node in self.nodes:
            node.release()

    def reset(self, seed: int) -> None:
        """Begin a run, or begin anew in this one."""
        if self.stamp.revision < self.revision:
            self._forget_changes()  # who owns time has begun anew
        for node in self.nodes:
            node.reset(seed)

    def close(self) -> None:
        """End the nodes' work."""
        for node in self.nodes:
            node.node.close()

    def diagnostics(self) -> Mapping[str, object]:
        """Return what the nodes say of their health, and what their joins have missed."""
        values: dict[str, object] = {}
        for node in self.nodes:
            values.update(node.node.diagnostics())
            values.update({f"late/{key}": count for key, count in node.join.late.items()})
        values["missed_ticks"] = max(node.join.missed_ticks for node in self.nodes)
        return values

    def _on_return(self, name: str) -> None:
        if name in self._resets_with:
            self.reset(self.stamp.seed)

    def _answer(
        self, node: _Stepped, call: Call[Any, Any], request: Message, reply: Reply[Any]
    ) -> None:
        try:
            reply.answer(node.node.answer(call, request))
        except RefusedError as refusal:
            reply.refuse(str(refusal))


class _Stepped:
    """A node, and the joining of its inputs and the publishing of its outputs."""

    def __init__(self, name: str, kind: type[Node], service: Service, graph: Graph) -> None:
        scenario = service.scenario
        row = graph.row(name)
        self.row = row = row.namespaced(scenario.names) if scenario.robots else row
        self._service = service
        self.changes: deque[tuple[Stamp, Scenario]] = deque()
        """Of parameters: from which tick on, and what then counts."""
        self._held: list[Joined] = []
        """Steps whose parameters are not known yet."""
        self._is_own = name in scenario.programs
        make = partial(kind, scenario)
        self.node = guarded(name, make) if self._is_own else make()
        self._bus = service.bus
        self._tick_ns = service.tick_ns
        for rate in row.rates.values():
            scenario.ticks_per(rate)  # refuses one that does not suit the tick
        inputs = graph.resolved(row, lockstep=scenario.sim.mode == "lockstep")
        periods_ns = {
            i.topic: scenario.ticks_per(graph.rate(i.topic.key)) * service.tick_ns
            for i in inputs
            if i.rule == "due"
        }
        self.join = make_join(inputs, periods_ns, whole=scenario.sim.mode == "lockstep")
        self._publishers: dict[Topic[Any], Publisher[Any]] = {
            topic: service.bus.publisher(row.on_bus(topic)) for topic in row.outputs
        }
        self._aged = tuple(i.topic for i in inputs if i.rule != "every")

    def reset(self, seed: int) -> None:
        """Begin a run."""
        self._held.clear()
        while self.changes and self.changes[0][0].revision <= self._service.stamp.revision:
            self.node.configure(self.changes.popleft()[1])
        self.join.reset()
        self._last_ns: int | None = None
        self._known_ns: dict[Topic[Any], int] = {}
        self.node.reset(seed)

    def step(self, joined: Joined) -> None:
        """Make a step and publish what it gives."""
        stamp, samples = joined
        if stamp.revision > self._service.revision:
            self._held.append(joined)
            return
        if self._held:
            self._held.clear()  # a tick after them knows less: they lied
        if self.changes:
            self._configure(stamp)
        now_ns = stamp.time_ns
        known = self._known_ns
        ages_s = {topic: (now_ns - at_ns) / NS_PER_S for topic, at_ns in known.items()}
        inputs = Inputs(samples, ages_s)
        last_ns, self._last_ns = self._last_ns, now_ns
        period_ns = now_ns - last_ns if last_ns is not None else self._tick_ns
        tick = Tick(now_ns // self._tick_ns, now_ns, period_ns / NS_PER_S)
        outputs = self.node.step(tick, inputs)
        if self._is_own:
            check_outputs(self.row.name, self.row, outputs)
        for topic, reason in inputs.refused:
            self._bus.refuse(topic.key, reason)
        for topic in self._aged:
            if inputs.get(topic) is not None:
                known[topic] = now_ns
        for topic, message in outputs.items():
            self._publishers[topic].put(message, stamp)

    def release(self) -> None:
        """Make the steps that were held back for parameters that are known now."""
        held, self._held = self._held, []
        for joined in held:
            self.step(joined)

    def _configure(self, stamp: Stamp) -> None:
        """Let the changes count that are due at a tick; the first of a run begins it with them."""
        while self.changes:
            begins, scenario = self.changes[0]
            is_due = begins.run == stamp.run and begins.time_ns <= stamp.time_ns
            if not is_due and begins.revision > stamp.revision:
                break
            self.changes.popleft()
            self.node.configure(scenario)
            if self._last_ns is None:
                self.node.reset(stamp.seed)


def _deliver(
    topic: Topic[Any], nodes: Sequence[_Stepped], *, only_stamped: bool
) -> Callable[[Message, Stamp | None], None]:
    def deliver(message: Message, stamp: Stamp | None) -> None:
        if stamp is None and only_stamped:
            return
        for node in nodes:
            for joined in node.join.put(topic, message, stamp):
                node.step(joined)

    return deliver
