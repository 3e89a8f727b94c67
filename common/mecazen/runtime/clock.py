"""Simulated time: advances a world, tick by tick, in lockstep or in real time."""

from __future__ import annotations

import logging
import secrets
import time
from contextlib import suppress

from mecazen import keys
from mecazen.bus import Reply
from mecazen.config import Scenario
from mecazen.errors import ConfigError, MecazenError
from mecazen.graph import COLLECTOR, OBSERVERS
from mecazen.loading import to_toml
from mecazen.loop import Slot
from mecazen.messages import (
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
from mecazen.parameters import (
    LiveParameters,
    described,
    parameters,
    refuse_unknown,
    settings_of,
    to_message,
)
from mecazen.programs import classes
from mecazen.robots import join_key
from mecazen.runtime.host import LONGER_S, Host
from mecazen.runtime.pace import Pace, Schedule
from mecazen.wire import NS_PER_S, Stamp

logger = logging.getLogger(__name__)

OBSERVERS_S = 1.0
"""In real time, time to wait for observers once all other services are ready [s]."""
PRESENCE_POLL_S = 0.25
"""Time without an answer after which its service's liveliness is checked [s]."""
ARRIVED_AT_MOST = 100
"""Maximum number of samples accepted when a tick is due: many more than a tick consists of."""


class Clock:
    """Drives the loop of the process that contains the world, and answers `sim/…` queries.

    Raises:
        ConfigError: No service contains the world.
    """

    def __init__(self, host: Host) -> None:
        if host.clock is None:
            raise ConfigError("services: nothing to simulate without physics")
        self.host = host
        service = next(service for service in host.services if host.clock in service.turns)
        self.answers = [slot for turn in service.turns for slot in turn.slots if slot.lag]
        """The inputs with which the world answers a tick in the next one."""
        self.scenario: Scenario = host.scenario
        self.live = LiveParameters(host.scenario, host.check_world)
        self.lockstep = host.lockstep
        self.schedule = Schedule(self.scenario.sim.tick_s, self.scenario.sim.speed)
        self.tick = self.missed_deadlines = 0
        self.paused = False
        self.steps_left = 0
        self.step_reply: Reply[SimState] | None = None
        self.asked_reset: tuple[ResetRequest, Reply[SimState]] | None = None
        bus = host.bus
        self._workers = [
            join_key(*part)
            for part in host.scenario.parts
            if part not in host.parts and part[0] not in (*OBSERVERS, COLLECTOR)
        ]
        """The services of other processes that take turns."""
        self.pace = Pace(bus, self.scenario.sim.answer_timeout_s)
        self._parameters = bus.publisher(keys.PARAMETERS)
        for name in {key.partition(".")[0] for key in parameters(self.scenario)}:
            with suppress(ConfigError):  # a later import would take many ticks
                classes(name, self.scenario)
        configuration = to_toml(self.scenario)
        bus.serve(keys.SIM_STATE, lambda _, reply: reply.answer(self.sim_state()))
        bus.serve(keys.SIM_SCENARIO, lambda _, reply: reply.answer(String(data=configuration)))
        bus.serve(keys.SIM_PAUSE, lambda _, reply: self._pause(reply, paused=True))
        bus.serve(keys.SIM_RESUME, lambda _, reply: self._pause(reply, paused=False))
        bus.serve(keys.SIM_STEP, self._on_step)
        bus.serve(keys.SIM_RESET, self._on_reset)
        bus.serve(keys.SIM_SPEED, self._on_speed)
        bus.serve(keys.GET_PARAMETERS, self._on_get)
        bus.serve(keys.SET_PARAMETERS, self._on_set)
        bus.presence.on_change.append(self._on_presence)
        service.reports.append(self.diagnostics)
        self.reset(self.scenario.seed)

    @property
    def stamp(self) -> Stamp:
        """The stamp of the current tick."""
        return self.host.stamp

    def reset(self, seed: int) -> None:
        """Begin a run: return the world to its initial state."""
        self.live.begin()
        self.tick = self.missed_deadlines = 0
        self.host.begin(Stamp(0, secrets.randbits(32), seed))

    def run(self) -> None:
        """Wait until every service of the scenario is ready, then advance until stopped."""
        self._await_services()
        self.begin()
        while True:
            self.step()

    def begin(self) -> None:
        """Make the first tick of a run."""
        self.schedule.restart(self.tick)
        self._make_tick()

    def step(self) -> None:
        """Wait for the answers to this tick, then make the next tick.

        While time is paused, it waits. On a bus within one process that wait would never end, so
        it returns without a tick.
        """
        self._await_answers()
        if not self._hold():
            return
        if self.asked_reset is not None:
            self._reset_as_asked(*self.asked_reset)
            return
        self.tick += 1
        self._make_tick()
        if self.paused and self.steps_left:
            self.steps_left -= 1
            if self._at_the_end:
                self.steps_left = 0
            if not self.steps_left and self.step_reply is not None:
                self.step_reply.answer(self.sim_state())
                self.step_reply = None

    def _make_tick(self) -> None:
        """Advance the world to this tick and run the other turns of the process."""
        host, now_ns = self.host, self.tick * self.host.tick_ns
        has_changed = self.live.apply()
        host.stamp = stamp = Stamp(now_ns, self.stamp.run, self.stamp.seed)
        if has_changed:
            self.scenario = self.live.scenario
            host.configure(self.scenario)
        is_full_second = now_ns % NS_PER_S < host.tick_ns
        # in real time, services may still have the parameters of a clock that has ended
        is_first = not self.tick and not self.lockstep
        if has_changed or is_first or (self.live.settings and is_full_second):
            self._publish_parameters()
        if has_changed and self.lockstep:
            self.pace.confirm(self._workers)
        self.schedule.published(self.tick)
        host.loop.step(self.tick, stamp, self._await)
        host.has_news = True  # a command may have arrived after the turn that uses it
        host.report_if_due()

    def _await_answers(self) -> None:
        """Deliver samples until the tick is answered (lockstep) or the next is due (real time)."""
        for slot in self.answers:
            slot.expect(self.tick + 1, self.tick)
        if not any(slot.is_remote and slot.awaited is not None for slot in self.answers):
            self.host.bus.drain()  # no wait below would deliver what has arrived
        self.host.revise()
        if self.lockstep or self.paused:
            self._await_all()
            if self.lockstep:
                self.pace.keep(self.tick + 1)
        elif self.tick == 0:
            # first answers take longer, so time starts only once they have arrived
            self._await_all()
            self.missed_deadlines += bool(self._unanswered)
            self.schedule.restart(self.tick)
        else:
            self._await_due()

    @property
    def _unanswered(self) -> list[Slot]:
        return [slot for slot in self.answers if slot.is_missing]

    def _await_all(self) -> None:
        begin_s = time.monotonic()
        deadline = begin_s + self.scenario.sim.answer_timeout_s
        while self.asked_reset is None and (missing := self._unanswered):
            if self._deliver(PRESENCE_POLL_S):
                continue
            if self.lockstep:
                self._refuse_silence(missing, begin_s)
            elif self.tick or self._gone(missing) or time.monotonic() > deadline:
                return

    def _await(self, slot: Slot) -> bool:
        """Wait for a sample that a turn lacks; return False if a reset ends the tick."""
        begin_s = time.monotonic()
        while self.asked_reset is None:
            if not slot.is_missing:
                return True
            if self.lockstep:
                if not self.host.bus.spin_once(PRESENCE_POLL_S):
                    self._refuse_silence([slot], begin_s)
                continue
            wait_s = self.schedule.wait_s(self.tick, answered=False)
            if slot.lag or wait_s <= 0.0 or self.paused:
                return True
            self.host.bus.spin_once(wait_s)
        return False

    def _gone(self, slots: list[Slot]) -> list[str]:
        names = self.host.givers(slots)
        return [name for name in names if name not in self.host.bus.presence.names]

    def _refuse_silence(self, missing: list[Slot], begin_s: float) -> None:
        """Raise MecazenError if a service that has not answered is gone or silent."""
        gone = self._gone(missing)
        waited_s = time.monotonic() - begin_s
        if self.host.bus.hears_itself:  # nothing can arrive within one process
            waited_s = min(map(self.host.patience_s, missing)) + LONGER_S / 2.0
        silent = [
            slot
            for slot in missing
            if not slot.is_remote  # its turn is over
            or waited_s > self.host.patience_s(slot)
        ]
        if gone or silent:
            raise self.host.silence_of(gone or self.host.givers(silent))

    def _deliver(self, timeout_s: float | None) -> bool:
        has_come = self.host.bus.spin_once(timeout_s)
        self.host.revise()
        return has_come

    def _await_due(self) -> None:
        while self.asked_reset is None and not self.paused:
            wait_s = self.schedule.wait_s(self.tick, answered=not self._unanswered)
            if wait_s <= 0.0:
                # use what has arrived by now, up to a limit, since a flood may not end
                for _ in range(ARRIVED_AT_MOST):
                    if not self._unanswered or not self._deliver(0.0):
                        break
                break
            self._deliver(wait_s)
        if self._unanswered and self.asked_reset is None and not self.paused:
            self.missed_deadlines += 1

    def sim_state(self) -> SimState:
        """Return the state of simulated time."""
        return SimState(
            clock=self.stamp.time,
            tick=self.tick,
            run=self.stamp.run,
            seed=self.stamp.seed,
            mode=self.scenario.sim.mode,
            paused=self.paused,
            speed=self.schedule.speed,
            rtf=self.schedule.rtf,
            missed_deadlines=self.missed_deadlines,
        )

    def diagnostics(self) -> dict[str, object]:
        """Return mode, real-time factor if known, missed deadlines and whether time is paused."""
        rtf = round(self.schedule.rtf, 3)
        return {
            "mode": self.scenario.sim.mode,
            **({"rtf": rtf} if rtf else {}),
            "missed_deadlines": self.missed_deadlines,
            "paused": self.paused,
        }

    def _pause(self, reply: Reply[SimState], *, paused: bool) -> None:
        self._end_stepping(f"{'paused' if paused else 'resumed'} meanwhile")
        self.paused = paused
        self.schedule.restart(self.tick)
        reply.answer(self.sim_state())

    def _on_step(self, request: StepRequest, reply: Reply[SimState]) -> None:
        """Simulate a number of ticks while paused; answer after the last one."""
        if not self.paused:
            reply.refuse("not paused: `mecazen sim pause` first")
        elif self._at_the_end:
            reply.refuse("the run has ended: `mecazen sim reset` begins another")
        elif self.steps_left:
            reply.refuse("still stepping")
        else:
            self.steps_left, self.step_reply = request.ticks, reply

    def _on_reset(self, request: ResetRequest, reply: Reply[SimState]) -> None:
        """Request a reset, which happens between two ticks; answer after it."""
        if self.asked_reset is not None:
            reply.refuse("already resetting")
        else:
            self.asked_reset = request, reply

    def _on_speed(self, request: SpeedRequest, reply: Reply[SimState]) -> None:
        if self.lockstep:
            reply.refuse("lockstep goes as fast as it can: there is no speed to set")
            return
        if "hardware" in self.scenario.services:
            reply.refuse("the time of a real robot is the wall clock: there is no speed to set")
            return
        self.schedule = Schedule(self.scenario.sim.tick_s, request.speed)
        self.schedule.restart(self.tick)
        reply.answer(self.sim_state())

    def _on_get(self, request: ParameterNames, reply: Reply[ParameterDescriptors]) -> None:
        live = parameters(self.live.requested)
        names = request.names or tuple(live)
        try:
            refuse_unknown(self.live.requested, names)
        except ConfigError as error:
            reply.refuse(str(error))
        else:
            descriptors = tuple(described(name, live[name]) for name in names)
            reply.answer(ParameterDescriptors(parameters=descriptors))

    def _on_set(self, request: Parameters, reply: Reply[Parameters]) -> None:
        """Change parameters from the next tick on; answer with that tick's time."""
        try:
            self.live.set(settings_of(request))
        except ConfigError as error:
            reply.refuse(str(error))
            return
        begins = Stamp((self.tick + 1) * self.host.tick_ns, self.stamp.run, self.stamp.seed)
        reply.answer(Parameters(header=Header(stamp=begins.time), parameters=request.parameters))

    def _on_presence(self) -> None:
        if self.live.settings:  # for a service that starts late
            self._publish_parameters()

    def _publish_parameters(self) -> None:
        """Publish the changed parameters; at the first tick of a run also that there are none."""
        header = Header(stamp=self.stamp.time)
        message = Parameters(header=header, parameters=to_message(self.live.settings))
        self._parameters.put(message, self.stamp)

    def _await_services(self) -> None:
        awaited = set(self.scenario.services) - {service for service, _ in self.host.parts}
        observers = set() if self.lockstep else awaited & set(OBSERVERS)
        timeout_s = self.scenario.sim.answer_timeout_s
        missing = self._await_ready(awaited - observers, timeout_s)
        missing += self._await_ready(observers, OBSERVERS_S)
        if missing and self.lockstep:
            raise MecazenError(
                f"not there within sim.answer_timeout_s = {timeout_s:g}: {', '.join(missing)}"
            )
        if missing:
            logger.warning("msg=%r", f"going on without {', '.join(missing)}")

    def _await_ready(self, names: set[str], timeout_s: float) -> list[str]:
        """Wait for services of each robot to be ready; return those that are not in time."""
        deadline = time.monotonic() + timeout_s
        while True:
            missing = [
                join_key(name, robot)
                for name, robot in self.scenario.parts
                if name in names
                if join_key(f"{name}/ready", robot) not in self.host.bus.presence.names
            ]
            if not missing or (left_s := deadline - time.monotonic()) <= 0.0:
                return missing
            self.host.bus.spin_once(left_s)

    @property
    def _at_the_end(self) -> bool:
        return self.lockstep and self.tick >= self.scenario.sim.ticks - 1

    def _hold(self) -> bool:
        """Deliver what arrives while time is paused or at its end; return whether it continues."""
        while self.asked_reset is None and (
            (self.paused and not self.steps_left) or self._at_the_end
        ):
            if not self._deliver(None):
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
