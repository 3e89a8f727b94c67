"""Simulated time: advances a world, tick by tick, in lockstep or in real time."""

from __future__ import annotations

import logging
import secrets
import time
from collections.abc import Mapping
from contextlib import suppress
from functools import partial

from mecazen import keys
from mecazen.bus import Bus, Reply
from mecazen.config import Scenario
from mecazen.errors import ConfigError, NodeError, StepTimeoutError
from mecazen.graph import OBSERVERS, Graph
from mecazen.loading import to_toml
from mecazen.messages import (
    Clock,
    Empty,
    Header,
    ParameterDescriptors,
    ParameterNames,
    Parameters,
    ResetRequest,
    SimState,
    SpeedRequest,
    StepRequest,
    String,
)
from mecazen.node import Tick, World
from mecazen.parameters import described, parameters, refuse_unknown, settings_of, to_message
from mecazen.programs import classes
from mecazen.robots import join_key
from mecazen.runtime.changing import Changing, refuse_unsuitable
from mecazen.runtime.link import Answer, Link
from mecazen.runtime.own import check_outputs, guarded
from mecazen.runtime.participant import Participant
from mecazen.runtime.schedule import Schedule
from mecazen.wire import NS_PER_S, Stamp

logger = logging.getLogger(__name__)

OBSERVERS_S = 1.0
"""In real time, how long observers may come after all others are ready and miss nothing."""
PRESENCE_POLL_S = 0.25
"""How long an answer may be missing before its service is looked for."""
ARRIVED_AT_MOST = 100
"""Samples that are still taken when a tick is due: many more than make up a tick."""


class TimeOwner(Participant):
    """The clock, and the world that it advances.

    At every tick it publishes `clock` and the world's state of each robot, waits until the tick
    is answered by every node that gives an input of the world, and advances the world to the
    next. It answers `sim/…`.

    Args:
        name: The service's name.
        bus: Without a robot's namespace.
        scenario: The whole scenario.
        graph: Its nodes.
        world: The class of what is advanced.
    """

    def __init__(
        self, name: str, bus: Bus, scenario: Scenario, graph: Graph, world: type[World]
    ) -> None:
        super().__init__(name, bus, scenario)
        self.changing = Changing(scenario, refuse_unsuitable)
        self.lockstep = scenario.sim.mode == "lockstep"
        self._row = row = world.row(scenario)
        self._is_own = name in scenario.programs
        make = partial(world, scenario)
        self.world = guarded(name, make) if self._is_own else make()
        self.pending: set[Answer] = set()
        """What is still to come in answer to the tick."""
        self.links = [
            Link(robot, self, row, graph, self.world, self.pending) for robot in scenario.names
        ]
        self.schedule = Schedule(scenario.sim.tick_s, scenario.sim.speed)
        self.paused = False
        self.steps_left = 0
        self.step_reply: Reply[SimState] | None = None
        self.asked_reset: tuple[ResetRequest, Reply[SimState]] | None = None
        self._clock = bus.publisher(keys.CLOCK) if scenario.robots else None
        """Simulated time for all robots together, in no one's namespace."""
        self._parameters = bus.publisher(keys.PARAMETERS)
        for service in {key.partition(".")[0] for key in parameters(scenario)}:
            with suppress(ConfigError):  # to import it later would take many ticks
                classes(service, scenario)
        configuration = to_toml(scenario)
        bus.serve(keys.SIM_STATE, lambda _, reply: reply.answer(self.sim_state()))
        bus.serve(keys.SIM_SCENARIO, lambda _, reply: reply.answer(String(data=configuration)))
        bus.serve(keys.SIM_PAUSE, self._on_pause)
        bus.serve(keys.SIM_RESUME, self._on_resume)
        bus.serve(keys.SIM_STEP, self._on_step)
        bus.serve(keys.SIM_RESET, self._on_reset)
        bus.serve(keys.SIM_SPEED, self._on_speed)
        bus.serve(keys.GET_PARAMETERS, self._on_get)
        bus.serve(keys.SET_PARAMETERS, self._on_set)
        for link in self.links:  # for who comes after a change
            link.bus.presence.on_change.append(self._publish_parameters)
        self.reset(scenario.seed)

    def reset(self, seed: int) -> None:
        """Begin a run: the world back at its start."""
        self.world.reset(seed)
        self.tick = self.missed_deadlines = 0
        self.stamp = Stamp(0, secrets.randbits(32), seed)
        for link in self.links:
            link.reset(self.stamp)

    def close(self) -> None:
        """End the world's work."""
        self.world.close()

    def run(self) -> None:
        """Wait until every service of the scenario is ready; then advance until stopped."""
        self._await_services()
        self.begin()
        while True:
            self.step()

    def begin(self) -> None:
        """Publish the first state of a run."""
        self.schedule.restart(self.tick)
        self._advance()

    def step(self) -> None:
        """Wait for the answers to this tick, advance the world by one, publish its new state.

        While time is held, it waits; where that would have no end, on the bus within a
        process, it returns and nothing has happened.
        """
        self.await_answers()
        if not self._hold():
            return
        if self.asked_reset is not None:
            self._reset_as_asked(*self.asked_reset)
            return
        self.tick += 1
        self._advance()
        if self.paused and self.steps_left:
            self.steps_left -= 1
            if self._at_the_end:
                self.steps_left = 0
            if not self.steps_left and self.step_reply is not None:
                self.step_reply.answer(self.sim_state())
                self.step_reply = None

    def await_answers(self) -> None:
        """Deliver what arrives until the tick is answered (lockstep) or due (real time).

        Raises:
            StepTimeoutError: A service that takes part is gone or silent, in lockstep.
        """
        if not any(link.awaits for link in self.links):
            self.bus.drain()  # no answer is awaited: what has come is delivered
        if self.lockstep or self.paused:
            self._await_all()
        elif self.tick == 0:
            # every first answer takes longer, and is not owed yet: time begins with it
            self._await_all()
            self.schedule.restart(self.tick)
        else:
            self._await_due()

    def _advance(self) -> None:
        """Bring the world to the present tick and publish its state."""
        changes = self.changing.take(self.tick)
        if changes:
            self.scenario = self.changing.scenario
            self.world.configure(self.scenario)
            if self.tick == 0:
                self.world.reset(self.stamp.seed)
        inputs = {link.name: link.inputs() for link in self.links}
        now_ns = self.tick * self.tick_ns
        period_s = self.tick_ns / NS_PER_S if self.tick else 0.0
        outputs = self.world.step(Tick(self.tick, now_ns, period_s), inputs)
        if self._is_own:
            self._check(outputs)
        self.stamp = Stamp(now_ns, self.stamp.run, self.stamp.seed, self.changing.revision)
        if changes or now_ns % NS_PER_S < self.tick_ns:
            self._publish_parameters()
        if self._clock is not None:
            self._clock.put(Clock(clock=self.stamp.time), self.stamp)
        for link in self.links:
            link.note(inputs[link.name])
            link.begin_tick(self.stamp)
        for link in self.links:
            link.publish(outputs[link.name])
        self.schedule.published(self.tick)
        if now_ns % NS_PER_S < self.tick_ns:
            self.publish_diagnostics()

    def _check(self, outputs: object) -> None:
        """Refuse what a world of one's own gives, where the runtime or others can't take it."""
        robots = [link.name for link in self.links]
        if not isinstance(outputs, Mapping) or set(outputs) != set(robots):
            raise NodeError(f"{self.name}: step must return the outputs of each robot of {robots}")
        for of_robot in outputs.values():
            check_outputs(self.name, self._row, of_robot)

    def sim_state(self) -> SimState:
        """Return what simulated time does."""
        return SimState(
            clock=self.stamp.time,
            tick=self.tick,
            seed=self.stamp.seed,
            mode=self.scenario.sim.mode,
            paused=self.paused,
            speed=self.schedule.speed,
            rtf=self.schedule.rtf,
            missed_deadlines=self.missed_deadlines,
        )

    def diagnostics(self) -> dict[str, object]:
        """Return the real-time factor, missed deadlines, and what the world says."""
        return {
            "mode": self.scenario.sim.mode,
            "rtf": round(self.schedule.rtf, 3),
            "missed_deadlines": self.missed_deadlines,
            "paused": self.paused,
            **self.world.diagnostics(),
        }

    def _on_pause(self, request: Empty, reply: Reply[SimState]) -> None:
        """Hold simulated time at this tick."""
        del request
        self._end_stepping("paused meanwhile")
        self.paused = True
        reply.answer(self.sim_state())

    def _on_resume(self, request: Empty, reply: Reply[SimState]) -> None:
        """Let simulated time go on."""
        del request
        self._end_stepping("resumed meanwhile")
        self.paused = False
        self.schedule.restart(self.tick)
        reply.answer(self.sim_state())

    def _on_step(self, request: StepRequest, reply: Reply[SimState]) -> None:
        """Simulate some ticks while paused; the answer comes when they are done."""
        if not self.paused:
            reply.refuse("not paused: `sim/pause` first")
        elif self._at_the_end:
            reply.refuse("the run has ended: `sim/reset` begins it anew")
        elif self.steps_left:
            reply.refuse("still stepping")
        else:
            self.steps_left, self.step_reply = request.ticks, reply

    def _on_reset(self, request: ResetRequest, reply: Reply[SimState]) -> None:
        """Ask for a reset, done between two ticks; the answer comes when it is done."""
        if self.asked_reset is not None:
            reply.refuse("already resetting")
        else:
            self.asked_reset = request, reply

    def _on_speed(self, request: SpeedRequest, reply: Reply[SimState]) -> None:
        """Go on at another speed."""
        if self.lockstep:
            reply.refuse("lockstep goes as fast as it can: there is no speed to set")
            return
        self.schedule = Schedule(self.scenario.sim.tick_s, request.speed)
        self.schedule.restart(self.tick)
        reply.answer(self.sim_state())

    def _on_get(self, request: ParameterNames, reply: Reply[ParameterDescriptors]) -> None:
        """Tell what can be changed, and how it is."""
        found = parameters(self.changing.wanted)
        names = request.names or tuple(found)
        try:
            refuse_unknown(self.changing.wanted, dict.fromkeys(names, ""))
        except ConfigError as error:
            reply.refuse(str(error))
        else:
            descriptors = tuple(described(name, found[name]) for name in names)
            reply.answer(ParameterDescriptors(parameters=descriptors))

    def _on_set(self, request: Parameters, reply: Reply[Parameters]) -> None:
        """Change parameters from the next tick on; the answer tells which that is."""
        try:
            self.changing.ask(settings_of(request))
        except ConfigError as error:
            reply.refuse(str(error))
            return
        begins = Stamp((self.tick + 1) * self.tick_ns, self.stamp.run, self.stamp.seed)
        reply.answer(
            Parameters(
                header=Header(stamp=begins.time),
                revision=self.changing.revision + 1,
                parameters=request.parameters,
            )
        )

    def _publish_parameters(self) -> None:
        """Publish what has been changed, if anything was: now and then, for who comes late."""
        if self.changing.revision:
            message = Parameters(
                header=Header(stamp=self.stamp.time),
                revision=self.changing.revision,
                parameters=to_message(self.changing.settings),
            )
            self._parameters.put(message, self.stamp)

    def _is_current(self, stamp: Stamp) -> bool:
        return stamp.run == self.stamp.run

    def _await_services(self) -> None:
        others = set(self.scenario.services) - {self.name}
        observers = set() if self.lockstep else others & set(OBSERVERS)
        missing = self._await_ready(others - observers, self.scenario.sim.answer_timeout_s)
        missing += self._await_ready(observers, OBSERVERS_S)
        if missing and self.lockstep:
            raise StepTimeoutError(f"not there to start with: {', '.join(missing)}")
        if missing:
            logger.warning("msg=%r", f"going on without {', '.join(missing)}")

    def _await_ready(self, names: set[str], timeout_s: float) -> list[str]:
        """Wait until services of each robot are ready, and return those that are not in time."""
        deadline = time.monotonic() + timeout_s
        while True:
            missing = [
                join_key(name, link.name)
                for link in self.links
                for name in sorted(names)
                if f"{name}/ready" not in link.bus.presence.names
            ]
            if not missing or (left_s := deadline - time.monotonic()) <= 0.0:
                return missing
            self.bus.spin_once(left_s)

    def _await_all(self) -> None:
        deadline = time.monotonic() + self.scenario.sim.answer_timeout_s
        while self.pending and self.asked_reset is None:
            if self.bus.spin_once(PRESENCE_POLL_S):
                continue
            gone = [part for link in self.links for part in link.gone]
            if self.lockstep and (gone or time.monotonic() > deadline):
                missing = ", ".join(gone or (part for link in self.links for part in link.awaited))
                raise StepTimeoutError(
                    f"{missing} did not answer tick {self.tick} (t = {self.stamp.time_ns / 1e9} s)"
                )
            if not self.lockstep:
                return

    def _await_due(self) -> None:
        while self.asked_reset is None and not self.paused:
            wait_s = self.schedule.wait_s(self.tick, answered=not self.pending)
            if wait_s <= 0.0:
                # what has arrived by now still counts, but a flood has no end
                for _ in range(ARRIVED_AT_MOST):
                    if not self.pending or not self.bus.spin_once(0.0):
                        break
                break
            self.bus.spin_once(wait_s)
        if self.pending and self.asked_reset is None and not self.paused:
            self.missed_deadlines += 1

    @property
    def _at_the_end(self) -> bool:
        return self.lockstep and self.tick >= self.scenario.sim.ticks - 1

    def _hold(self) -> bool:
        """Deliver what arrives while simulated time is held; return whether it goes on."""
        while self.asked_reset is None and (
            (self.paused and not self.steps_left) or self._at_the_end
        ):
            if not self.bus.spin_once():
                return False
        return True

    def _reset_as_asked(self, request: ResetRequest, reply: Reply[SimState]) -> None:
        self.asked_reset = None
        self._end_stepping("reset meanwhile")
        self.reset(self.stamp.seed if request.seed is None else request.seed)
        self.begin()
        reply.answer(self.sim_state())

    def _end_stepping(self, reason: str) -> None:
        self.steps_left = 0
        if self.step_reply is not None:
            self.step_reply.refuse(reason)
            self.step_reply = None
