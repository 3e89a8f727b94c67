"""The services of a process: their turns, the loop over them, and the bus around them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

from mecazen import keys
from mecazen.bus import Bus, Reply
from mecazen.config import Scenario
from mecazen.errors import ConfigError, MecazenError, RefusedError
from mecazen.graph import SHARED
from mecazen.keys import Call, Topic, call_of_robot
from mecazen.loop import Loop, Slot, Turn, awaited_services, turns_of
from mecazen.messages import Clock, Message
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.parameters import changed, settings_of
from mecazen.programs import Kind, classes, graph_of
from mecazen.robots import join_key
from mecazen.runtime.observer import PUBLISHERS, Health
from mecazen.runtime.pace import serve_every
from mecazen.wire import NS_PER_S, Stamp

EARLY_AT_MOST = 16
"""Maximum number of samples kept for a run that has not begun in this process."""

LONGER_S = 0.5
"""Additional time to wait for a turn, compared with a turn that it waits for [s]. This exceeds the
time until a process notes the end of a wait."""

Part = tuple[str, str]
"""A service and its robot; the robot is empty for a single robot and for shared services."""


def part_of(service: str, scenario: Scenario, robot: str) -> Scenario:
    """Return the scenario of a service: the whole scenario, or its robot's part.

    Raises:
        ConfigError: The robot does not exist, is missing, or is named for a shared service.
    """
    if service in SHARED and robot:
        raise ConfigError(f"--robot {robot}: there is one {service} for all robots")
    if service not in SHARED and scenario.robots and not robot:
        raise ConfigError(f"{service}: of which robot? --robot takes {' or '.join(scenario.names)}")
    return scenario if service in SHARED else scenario.of(robot)


class ClockNode(Node):
    """Publishes the time of each tick, before everything else in it."""

    def reset(self, seed: int) -> None:
        """The time comes with the tick."""

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the time, also within the namespace of each robot."""
        time = Clock(clock=tick.time)
        return {keys.of_robot(keys.CLOCK, name): time for name in ("", *self.scenario.names)}


class Service(Health):
    """A service of a process: its turns and its health."""

    def __init__(
        self, name: str, robot: str, turns: Sequence[Turn], bus: Bus, scenario: Scenario
    ) -> None:
        self.name, self.turns = name, turns
        self.reports: list[Callable[[], Mapping[str, object]]] = [self._publishers]
        """Functions that return further values for its diagnostics."""
        inputs = {
            slot.on_bus.name if robot else slot.on_bus.key: slot
            for turn in turns
            for slot in turn.slots
            if not slot.topic.by_hand
        }
        super().__init__(name, robot, bus, scenario, inputs)

    def diagnostics(self) -> dict[str, object]:
        """Return the nodes' diagnostics, and counts of late samples and missed ticks."""
        values = {name: value for report in self.reports for name, value in report().items()}
        for turn in self.turns:
            with turn.calling():
                values.update(turn.running.diagnostics())
            for slot in turn.slots:
                if slot.rule == "due":
                    values[f"late/{slot.topic.name}"] = slot.late
        values["missed_ticks"] = max(turn.missed for turn in self.turns)
        return values

    def _publishers(self) -> dict[str, str]:
        """Return the programs that have published on open keys since the last report, by key."""
        slots = (slot for turn in self.turns for slot in turn.slots if slot.topic.open)
        opened = {self.bus.key_of(slot.on_bus) for slot in slots}
        senders = {key: self.bus.senders.pop(key, ()) for key in opened}
        return {f"{PUBLISHERS}{key}": " ".join(sorted(ids)) for key, ids in senders.items() if ids}


class Host:
    """The services of a process, with their loop; a clock or a worker drives the loop.

    Args:
        parts: The services, each with its robot.
        bus: Connection to other processes and tools.
        scenario: The whole scenario.
        kinds: Classes by node name; None: all classes that the scenario names.

    Raises:
        ConfigError: A service does not exist, or the scenario does not suit a node.

    Attributes:
        turns: All turns of the scenario, in the order in which they are taken.
        loop: The loop that takes the turns of this process.
        stamp: The stamp of the newest tick.
        clock: The turn that owns time, if this process contains it.
        next_run: The stamp of a sample of a new run that has to begin; None if there is none.
        has_news: Whether a sample that may repeat a step has arrived since `revise`.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        bus: Bus,
        scenario: Scenario,
        kinds: Mapping[str, Kind] | None = None,
    ) -> None:
        self.bus, self.parts, self.scenario = bus, tuple(parts), scenario
        self._started = scenario
        self.tick_ns = scenario.sim.tick_ns
        self.lockstep = scenario.sim.mode == "lockstep"
        for service, robot in parts:
            part_of(service, scenario, robot)
        if kinds is None:
            named = dict.fromkeys(service for service, _ in parts)
            kinds = {name: kind for part in named for name, kind in classes(part, scenario).items()}
        self.graph = graph_of(scenario, kinds)
        self.turns = turns_of(scenario, self.graph)
        self.loop = self._make_loop({**kinds, "clock": ClockNode})
        self.clock = next((turn for turn in self.loop.turns if turn.row.owns_time), None)
        self.services = [
            Service(
                *part, [t for t in self.loop.turns if t.service == join_key(*part)], bus, scenario
            )
            for part in parts
        ]
        self.stamp = Stamp(0, 0, scenario.seed)
        self.next_run: Stamp | None = None
        self.has_news = False
        self._ended: deque[int] = deque(maxlen=16)
        self._early: deque[tuple[Sequence[Slot], Message | None, Stamp]] = deque(
            maxlen=EARLY_AT_MOST
        )
        self._changed: tuple[Stamp, Scenario] | None = None
        """A scenario with changed parameters, and the stamp of the first tick with them."""
        self._reported_s = -1
        self._subscribe()
        self._serve()
        bus.presence.on_return.append(self._on_return)
        with ExitStack() as failed:
            failed.callback(self.close)
            self.begin(self.stamp)
            failed.pop_all()

    def begin(self, stamp: Stamp) -> None:
        """Begin a run, with the samples of it that have already arrived."""
        if stamp.run != self.stamp.run:
            self._ended.append(self.stamp.run)
        self.stamp = stamp
        self.loop.begin(stamp)
        self.next_run = None
        self._reported_s = -1
        for turn in self.loop.turns:
            turn.reset(stamp.seed)
        for service in self.services:
            service.reset()
        early = [sample for sample in self._early if sample[2].run == stamp.run]
        self._early.clear()
        for slots, message, sent in early:
            self._receive(slots, message, sent)

    def configure(self, scenario: Scenario) -> None:
        """Apply a scenario with changed parameters from the next tick on."""
        self.scenario = scenario
        for turn in self.loop.turns:
            turn.configure(scenario, self.stamp.seed)

    def check_world(self, scenario: Scenario) -> None:
        """Refuse a changed scenario that the state of a node does not allow; raises ConfigError."""
        for turn in self.loop.turns:
            with turn.calling():
                turn.running.check_world(scenario.of(turn.robot) if turn.robot else scenario)

    def apply_changes(self, stamp: Stamp) -> None:
        """Apply the changed parameters that are due in a tick."""
        if self._changed is not None:
            begins, scenario = self._changed
            if begins.run != stamp.run or begins.time_ns <= stamp.time_ns:
                self._changed = None
                self.configure(scenario)

    def revise(self) -> None:
        """Repeat steps for which a newer command has arrived."""
        if self.has_news:
            self.has_news = False
            self.loop.revise()

    def put(self, topic: Topic[Any], message: Message) -> None:
        """Publish a message without a stamp, as an external program would, to all processes."""
        if topic.key in self._slots_of:
            self._arrive(self._slots_of[topic.key], message, None)
        self.bus.publisher(topic).put(message, None)

    def report_if_due(self) -> None:
        """Publish the health of the services once a simulated second."""
        second = self.stamp.time_ns // NS_PER_S
        if second != self._reported_s:
            self._reported_s = second
            for service in self.services:
                service.publish(self.stamp, service.diagnostics())

    def is_awaited(self) -> bool:
        """Return whether the world waits for a service of this process, directly or not."""
        return not awaited_services(self.turns).isdisjoint(join_key(*part) for part in self.parts)

    def givers(self, slots: Iterable[Slot]) -> list[str]:
        """Return the services that publish the inputs of slots."""
        return sorted({slot.giver.service for slot in slots if slot.giver is not None})

    def patience_s(self, slot: Slot) -> float:
        """Return how long to wait for a sample in lockstep [s].

        A silent node delays all later turns of its tick. The wait for these is longer, so the
        process that waits for the silent node is the first to end, and names it.
        """
        depth = 0 if slot.giver is None else slot.giver.depth()
        return self.scenario.sim.answer_timeout_s + LONGER_S * depth

    def silence_of(self, services: Iterable[str]) -> MecazenError:
        """Return the error that services have not answered the present tick."""
        time_ns = self.stamp.time_ns
        return MecazenError(
            f"{', '.join(services)} did not answer tick {time_ns // self.tick_ns} "
            f"(t = {time_ns / NS_PER_S} s)"
        )

    def close(self) -> None:
        """Close all nodes, also if one fails; then raise its error."""
        with ExitStack() as exits:
            for turn in reversed(self.loop.turns):
                exits.callback(turn.close)

    def _make_loop(self, kinds: Mapping[str, Kind]) -> Loop:
        """Return the loop. Each output goes to the inputs that take it here, and to the bus."""
        parts = {join_key(*part) for part in self.parts}
        turns = [t for t in self.turns if t.service in parts and t.row.name in kinds]
        self._slots_of: dict[str, list[Slot]] = {}
        """The inputs of this process by the key on the bus."""
        for turn in turns:
            kind = kinds[turn.row.name]
            assert issubclass(kind, Node)  # a loop contains no observers
            turn.make(kind, self.scenario)
            for slot in turn.slots:
                slot.is_remote = slot.giver not in turns
                slot.keeps_all = self.lockstep
                self._slots_of.setdefault(slot.on_bus.key, []).append(slot)
            turn.remote = tuple(slot for slot in turn.slots if slot.is_remote)
        awaited = {
            slot.on_bus.key
            for turn in self.turns
            if turn not in turns
            for slot in turn.slots
            if slot.rule != "latest"
        }
        for turn in turns:
            for output in turn.outputs.values():
                key, publisher = output.on_bus.key, self.bus.publisher(output.on_bus)
                slots = self._slots_of.get(key, ())
                output.slots = [slot for slot in slots if not slot.topic.by_hand]
                output.put = publisher.put
                if self.lockstep and key in awaited:
                    output.put_nothing = publisher.put_nothing
        return Loop(turns, self.tick_ns, lambda topic, why: self.bus.refuse(topic.key, why))

    def _subscribe(self) -> None:
        """Subscribe to the inputs that other processes publish.

        On a bus within one process, the loop hands over what a turn of this process publishes.
        """
        for slots in self._slots_of.values():
            slot, topic, publisher = slots[0], slots[0].on_bus, self._sole_publisher(slots[0])
            if slot.is_remote or (topic.open and not publisher and not self.bus.hears_itself):
                nothing = partial(self._of_run, slots, None) if self.lockstep else None
                # a node that no process waits for makes every step, however slow it is
                every = self.lockstep and slot.giver is not None
                take = partial(self._arrive, slots)
                self.bus.subscribe(topic, take, every=every, nothing=nothing, sender=publisher)
            elif publisher and not self.bus.hears_itself:
                self.bus.subscribe(topic, partial(self._refuse, slot, publisher))
        if self.clock is None:
            world = next((turn.service for turn in self.turns if turn.row.owns_time), "")
            self.bus.subscribe(keys.PARAMETERS, self._on_parameters, every=True, sender=world)
            for service, robot in self.parts:
                serve_every(self.bus, service, robot)

    def _sole_publisher(self, slot: Slot) -> str:
        """Return the service that alone publishes an input; empty if others may do so."""
        may_others = slot.on_bus.open and not self.lockstep
        return "" if slot.giver is None or may_others else slot.giver.service

    def _refuse(self, slot: Slot, publisher: str, *_: object) -> None:
        """Refuse a sample that does not come from the service that alone publishes its topic."""
        self.bus.refuse(slot.on_bus.key, f"not from {publisher}, which alone publishes it")

    def _arrive(self, slots: Sequence[Slot], message: Message, stamp: Stamp | None) -> None:
        if stamp is not None:
            self._of_run(slots, message, stamp)
            return
        if publisher := self._sole_publisher(slots[0]):
            self._refuse(slots[0], publisher)
            return
        by_hand, tick = [s for s in slots if s.topic.by_hand], self.stamp.time_ns // self.tick_ns
        for slot in slots:
            if by_hand and not slot.topic.by_hand:
                slot.note(tick)  # health reports a key as one input
            elif slot.rule != "every":
                slot.give(message, tick)
                self.has_news = True

    def _of_run(self, slots: Sequence[Slot], message: Message | None, stamp: Stamp) -> None:
        """Receive a stamped sample of this run; keep one of a new run for later."""
        if stamp.run == self.stamp.run:
            self._receive(slots, message, stamp)
        elif self.clock is None and stamp.run not in self._ended:
            # another process may have begun a new run, and answered, before this process
            self._early.append((slots, message, stamp))
            # only a message of a node announces a run: no empty sample, no open topic, and no
            # topic without a publisher in the scenario, unless it triggers steps
            is_of_node = self._sole_publisher(slots[0]) or any(s.rule == "every" for s in slots)
            if message is not None and not slots[0].on_bus.open and is_of_node:
                self.next_run = stamp

    def _receive(self, slots: Iterable[Slot], message: Message | None, stamp: Stamp) -> None:
        tick = stamp.time_ns // self.tick_ns
        for slot in slots:
            if not slot.topic.by_hand:
                slot.receive(message, stamp, tick)
                self.has_news |= slot.revises

    def _on_parameters(self, message: Any, stamp: Stamp | None) -> None:
        if stamp is None:
            return
        try:
            scenario = changed(self._started, settings_of(message))
        except ConfigError as error:
            self.bus.refuse(keys.PARAMETERS.key, str(error))
        else:
            self._changed = (stamp, scenario) if scenario != self.scenario else None

    def _serve(self) -> None:
        """Answer the queries of the nodes' rows; the clock answers its own."""
        for turn in self.loop.turns:
            robots = self.scenario.names if turn.row.shared else (turn.robot,)
            for call in () if turn.row.owns_time else turn.row.calls:
                for robot in robots:
                    asked = call_of_robot(call, robot)
                    as_named = asked if turn.row.shared else call
                    self.bus.serve(asked, partial(_answer, turn, as_named))
            for key, files in turn.running.files().items():
                self.bus.serve_files(key, files)

    def _on_return(self, name: str) -> None:
        """Reset the nodes whose row requires it when a service has returned."""
        for turn in self.loop.turns:
            if name in [join_key(part, turn.robot) for part in turn.row.resets_with]:
                turn.reset(self.stamp.seed)


def _answer(turn: Turn, call: Call[Any, Any], request: Message, reply: Reply[Any]) -> None:
    try:
        with turn.calling():
            message = turn.running.answer(call, request)
        reply.answer(message)
    except RefusedError as refusal:
        reply.refuse(str(refusal))
