"""The services of a process: their nodes, the loop over them, and the bus around them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from mecazen import keys
from mecazen.bus import Bus, Reply
from mecazen.config import Scenario
from mecazen.errors import ConfigError, RefusedError, StepTimeoutError
from mecazen.graph import SHARED
from mecazen.keys import Call, Topic, call_of_robot
from mecazen.loop import Loop, Runner, Slot
from mecazen.messages import Message
from mecazen.node import Computing, Node, World
from mecazen.parameters import changed, settings_of
from mecazen.plan import Need, Turn, compile_plan
from mecazen.programs import Kind, classes, graph_of
from mecazen.robots import join_key, seed_of
from mecazen.runtime.health import Health
from mecazen.runtime.nodes import Hosted
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


@dataclass
class Service:
    """A service of a process: its nodes and its health."""

    name: str
    robot: str
    nodes: list[tuple[Hosted, Runner]]
    health: Health
    reports: list[Callable[[], Mapping[str, object]]] = field(default_factory=list)
    """Functions that return further values for its diagnostics."""

    def diagnostics(self) -> dict[str, object]:
        """Return the nodes' diagnostics, and counts of late samples and missed ticks."""
        values = {name: value for report in self.reports for name, value in report().items()}
        for hosted, runner in self.nodes:
            values.update(hosted.diagnostics())
            for slot in runner.slots:
                if slot.need.rule == "due":
                    values[f"late/{slot.need.topic.name}"] = slot.late
        missed = [runner.missed for _, runner in self.nodes if not runner.turn.is_world]
        if missed:
            values["missed_ticks"] = max(missed)
        return values


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
        loop: The loop that executes the plan.
        stamp: The stamp of the newest tick.
        world: The turn of the world, if this process contains it.
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
        found: dict[str, Kind] = {}
        for service in dict.fromkeys(service for service, _ in parts):
            found |= classes(service, scenario) if kinds is None else kinds
        self.graph = graph_of(scenario, found)
        self.plan = compile_plan(scenario, self.graph)
        self._turns = [turn for turn in self.plan.of(parts) if turn.row.name in found]
        self._local = {turn.number for turn in self._turns}
        self.hosted = [self._make(turn, found[turn.row.name]) for turn in self._turns]
        self.loop = self._loop()
        self.world = next((r for r in self.loop.runners if r.turn.is_world), None)
        self.services = [self._service(*part) for part in parts]
        self.stamp = Stamp(0, 0, scenario.seed)
        self.next_run: Stamp | None = None
        self.has_news = False
        self._ended: deque[int] = deque(maxlen=16)
        self._early: deque[tuple[Sequence[Slot], Message | None, Stamp]] = deque(
            maxlen=EARLY_AT_MOST
        )
        self.revision = 0
        """Number of parameter changes that have been applied here."""
        self._changes: dict[int, tuple[Stamp, Scenario]] = {}
        """Announced changes by revision: the first tick, and the scenario from then on."""
        self._reported_s = -1
        self._subscribe()
        self._serve()
        bus.presence.on_return.append(self._on_return)
        self.begin(self.stamp)

    def begin(self, stamp: Stamp) -> None:
        """Begin a run, with the samples of it that have already arrived."""
        if stamp.run != self.stamp.run:
            self._ended.append(self.stamp.run)
        if stamp.revision < self.revision:  # the process that owns time has restarted
            self.configure(self._started, 0)
        self.stamp = self.loop.stamp = stamp
        self.next_run = None
        self._reported_s = -1
        for hosted, runner in zip(self.hosted, self.loop.runners, strict=True):
            self._reset(hosted, runner)
        for service in self.services:
            service.health.reset()
        early = [one for one in self._early if one[2].run == stamp.run]
        self._early.clear()
        for slots, message, at in early:
            self._receive(slots, message, at)

    def _reset(self, hosted: Hosted, runner: Runner) -> None:
        with hosted.calling():
            runner.reset(seed_of(self.stamp.seed, hosted.turn.robot))

    def configure(self, scenario: Scenario, revision: int) -> None:
        """Apply a scenario with changed parameters from the next tick on."""
        self.scenario, self.revision = scenario, revision
        self._changes = {at: one for at, one in self._changes.items() if at > revision}
        for hosted, runner in zip(self.hosted, self.loop.runners, strict=True):
            robot = hosted.turn.robot
            hosted.configure(scenario.of(robot) if robot else scenario)
            if runner.last is None:
                with hosted.calling():
                    hosted.steps.reset(seed_of(self.stamp.seed, robot))

    def knows(self, stamp: Stamp) -> bool:
        """Apply the changes due in a tick; return whether all changes of its stamp are known."""
        due = [
            revision
            for revision, (begins, _) in self._changes.items()
            if revision <= stamp.revision
            or (begins.run == stamp.run and begins.time_ns <= stamp.time_ns)
        ]
        if due:
            self.configure(self._changes[max(due)][1], max(due))
        return stamp.revision <= self.revision

    def revise(self) -> None:
        """Repeat steps for which a newer command has arrived."""
        if self.has_news:
            self.has_news = False
            self.loop.revise()

    def put(self, topic: Topic[Any], message: Message) -> None:
        """Publish a message without a stamp, as an external program would, to all processes."""
        for slots in (self._by_key[topic.key],) if topic.key in self._by_key else ():
            self._arrive(slots, topic, message, None)
        self.bus.publisher(topic).put(message, None)

    def report_if_due(self) -> None:
        """Publish the health of the services once a simulated second."""
        second = self.stamp.time_ns // NS_PER_S
        if second != self._reported_s:
            self._reported_s = second
            for service in self.services:
                service.health.publish(self.stamp, service.diagnostics())

    def givers(self, slots: Iterable[Slot]) -> list[str]:
        """Return the services that publish the inputs of slots."""
        givers = [self.plan.giver(slot.need) for slot in slots]
        return sorted({giver.service for giver in givers if giver is not None})

    def patience_s(self, slot: Slot) -> float:
        """Return how long to wait for a sample in lockstep [s].

        A silent node delays all later turns of its tick. The wait for these is longer, so the
        process that waits for the silent node is the first to end, and names it.
        """
        return self.scenario.sim.answer_timeout_s + LONGER_S * self.plan.depth(slot.need)

    def silence_of(self, services: Iterable[str]) -> StepTimeoutError:
        """Return the error that services have not answered the present tick."""
        time_ns = self.stamp.time_ns
        return StepTimeoutError(
            f"{', '.join(services)} did not answer tick {time_ns // self.tick_ns} "
            f"(t = {time_ns / NS_PER_S} s)"
        )

    def service_of(self, runner: Runner) -> Service:
        """Return the service that a turn belongs to."""
        return next(s for s in self.services if runner in [other for _, other in s.nodes])

    def close(self) -> None:
        """Close the nodes."""
        for hosted in self.hosted:
            hosted.close()

    def _make(self, turn: Turn, kind: Kind) -> Hosted:
        assert issubclass(kind, Computing)  # a plan contains no observers
        robot = turn.robot
        scenario = self.scenario.of(robot) if robot else self.scenario
        is_own = turn.row.name in scenario.programs
        return Hosted(turn, kind, scenario, is_own=is_own)

    def _loop(self) -> Loop:
        """Return the loop. Each output goes to the inputs that take it here, and to the bus."""
        runners = []
        for hosted in self.hosted:
            turn = hosted.turn
            slots = [
                Slot(need, is_remote=need.giver not in self._local, keeps_all=self.lockstep)
                for need in turn.needs
            ]
            runners.append(Runner(turn, hosted.steps, slots, self.tick_ns))
        slots_of: dict[str, list[Slot]] = {}
        for runner in runners:
            for slot in runner.slots:
                slots_of.setdefault(slot.need.on_bus.key, []).append(slot)
        self._by_key = slots_of
        awaited = {
            need.on_bus.key
            for turn in self.plan.turns
            if turn.number not in self._local
            for need in turn.needs
            if need.rule != "latest"
        }
        for runner in runners:
            promises = []
            for topic, on_bus, period in runner.turn.gives:
                publisher = self.bus.publisher(on_bus)
                runner.takers[topic] = tuple(slots_of.get(on_bus.key, ())), publisher.put
                if self.lockstep and on_bus.key in awaited:
                    promises.append((topic, period, publisher.put_nothing))
            runner.promises = tuple(promises)
        return Loop(runners, self.tick_ns, lambda topic, why: self.bus.refuse(topic.key, why))

    def _service(self, name: str, robot: str) -> Service:
        nodes = [
            (hosted, runner)
            for hosted, runner in zip(self.hosted, self.loop.runners, strict=True)
            if hosted.turn.service == join_key(name, robot)
        ]
        inputs = {
            slot.need.on_bus.name if robot else slot.need.on_bus.key: slot
            for _, runner in nodes
            for slot in runner.slots
        }
        return Service(name, robot, nodes, Health(name, robot, self.bus, self.scenario, inputs))

    def _subscribe(self) -> None:
        """Subscribe to the inputs that other processes publish."""
        for slots in self._by_key.values():
            need = slots[0].need
            giver = self._giver(need)
            if not slots[0].is_remote and (giver or self.bus.hears_itself):
                if not self.bus.hears_itself:
                    self.bus.subscribe(need.on_bus, partial(self._refuse, need.on_bus, giver))
                continue
            take = partial(self._arrive, slots, need.on_bus)
            nothing = partial(self._of_run, slots, need.on_bus, None) if self.lockstep else None
            # a node that no process waits for makes every step, however slow it is
            every = self.lockstep and need.giver is not None
            self.bus.subscribe(need.on_bus, take, every=every, nothing=nothing, of=giver)
        if self.world is None:
            world = next((turn.service for turn in self.plan.turns if turn.is_world), "")
            self.bus.subscribe(keys.PARAMETERS, self._on_parameters, every=True, of=world)

    def _giver(self, need: Need) -> str:
        """Return the service that alone publishes an input; empty if others may do so."""
        turn = self.plan.giver(need)
        may_others = need.on_bus.open and not self.lockstep
        return "" if turn is None or may_others else turn.service

    def _refuse(self, topic: Topic[Any], giver: str, *_: object) -> None:
        """Refuse a sample that does not come from the service that alone publishes its topic."""
        self.bus.refuse(topic.key, f"not from {giver}, which alone publishes it")

    def _arrive(
        self, slots: Sequence[Slot], topic: Topic[Any], message: Message, stamp: Stamp | None
    ) -> None:
        """Process a sample of another process."""
        if stamp is not None:
            self._of_run(slots, topic, message, stamp)
            return
        if giver := self._giver(slots[0].need):
            self._refuse(topic, giver)
            return
        for slot in slots:
            need = slot.need
            if need.rule != "every" or need.lag:
                slot.give(message, self.stamp.time_ns // self.tick_ns)
                self.has_news = True

    def _of_run(
        self, slots: Sequence[Slot], topic: Topic[Any], message: Message | None, stamp: Stamp
    ) -> None:
        """Receive a stamped sample of this run; keep one of a new run for later."""
        if stamp.run == self.stamp.run:
            self._receive(slots, message, stamp)
        elif self.world is None and stamp.run not in self._ended:
            # another process may have begun a new run, and answered, before this process
            self._early.append((slots, message, stamp))
            # only a message of a node announces a run: no empty sample, no open topic, and no
            # topic without a publisher in the scenario, unless it triggers steps
            need = slots[0].need
            is_of_node = self._giver(need) or any(slot.need.rule == "every" for slot in slots)
            if message is not None and not topic.open and is_of_node:
                self.next_run = stamp

    def _receive(self, slots: Iterable[Slot], message: Message | None, stamp: Stamp) -> None:
        tick = stamp.time_ns // self.tick_ns
        for slot in slots:
            slot.receive(message, stamp, tick)
            self.has_news |= slot.need.revises

    def _on_parameters(self, message: Any, stamp: Stamp | None) -> None:
        if stamp is None or message.revision <= self.revision:
            return
        try:
            scenario = changed(self._started, settings_of(message))
        except ConfigError as error:
            self.bus.refuse(keys.PARAMETERS.key, str(error))
        else:
            self._changes[message.revision] = stamp, scenario

    def _serve(self) -> None:
        """Answer the queries of the nodes' rows."""
        for hosted in self.hosted:
            row, node = hosted.turn.row, hosted.node
            robots = self.scenario.names if isinstance(node, World) else (hosted.turn.robot,)
            for robot in robots:
                for call in row.calls:
                    answer = partial(_answer, hosted, call, robot)
                    self.bus.serve(call_of_robot(call, robot), answer)
                if isinstance(node, World):
                    for prefix, files in node.files(robot).items():
                        self.bus.serve_files(join_key(prefix, robot), files)

    def _on_return(self, name: str) -> None:
        """Reset the nodes whose row requires it when a service has returned."""
        for hosted, runner in zip(self.hosted, self.loop.runners, strict=True):
            if name in [join_key(part, hosted.turn.robot) for part in hosted.turn.row.resets_with]:
                self._reset(hosted, runner)


def _answer(
    hosted: Hosted, call: Call[Any, Any], robot: str, request: Message, reply: Reply[Any]
) -> None:
    node = hosted.node
    try:
        with hosted.calling():
            if isinstance(node, World):
                message = node.answer(call, request, robot)
            else:
                assert isinstance(node, Node)
                message = node.answer(call, request)
        reply.answer(message)
    except RefusedError as refusal:
        reply.refuse(str(refusal))
