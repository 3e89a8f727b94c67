"""Physics: robots in their world, and the owner of simulated time."""

from __future__ import annotations

import logging
import secrets
import time

from mecazen import keys
from mecazen.bus import Bus, Reply
from mecazen.config import OBSERVERS, Scenario, whole_ticks
from mecazen.errors import StepTimeoutError
from mecazen.loading import to_toml
from mecazen.messages import (
    Clock,
    Empty,
    ResetRequest,
    SimState,
    SpeedRequest,
    StepRequest,
    String,
)
from mecazen.service import NS_PER_S, Service
from mecazen.wire import Stamp

from mecazen_physics.config import PhysicsConfig
from mecazen_physics.member import Member
from mecazen_physics.schedule import Schedule
from mecazen_physics.world import World

logger = logging.getLogger(__name__)

OBSERVERS_S = 1.0
"""In real time, how long onlookers may come after all others are ready and miss nothing."""
PRESENCE_POLL_S = 0.25
"""How long a missing answer may take before it is asked whether its service still lives."""

ARRIVED_AT_MOST = 100
"""Samples that are still taken when a tick is due: many more than make up a tick."""


class PhysicsService(Service):
    """Robots with every roller, and simulated time: lockstep or real time.

    At every tick physics publishes `clock`, `joint_states` and `ground_truth/odom`, waits for
    the tick's `joint_command` and `target/odom`, and simulates the next control period. Of
    several robots it does so in the namespace of each.
    """

    NAME = "physics"
    PRIORITY = 1
    OWNS_TIME = True

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        self.config = scenario.section(PhysicsConfig, "physics")
        self.steps_per_tick = whole_ticks("sim.tick_s", scenario.sim.tick_s, self.config.dt_s)
        self.lockstep = scenario.sim.mode == "lockstep"
        self.members = [
            Member(name, bus.namespaced(name), scenario.of(name)) for name in scenario.names
        ]
        self.schedule = Schedule(scenario.sim.tick_s, scenario.sim.speed)
        self.paused = False
        self.steps_left = 0
        self.step_reply: Reply[SimState] | None = None
        self.asked_reset: tuple[ResetRequest, Reply[SimState]] | None = None
        self.missed_deadlines = 0
        self.clock = bus.publisher(keys.CLOCK) if scenario.robots else None
        """Simulated time for all robots together, in no one's namespace."""
        super().__init__(bus, scenario)
        for member in self.members:
            self.subscribe(keys.JOINT_COMMAND, member.on_joint_command, robot=member.name)
            self.subscribe(keys.TARGET_ODOM, member.on_target_odom, robot=member.name)
        bus.serve(keys.SIM_STATE, lambda _, reply: reply.answer(self.sim_state()))
        configuration = to_toml(scenario)
        bus.serve(keys.SIM_SCENARIO, lambda _, reply: reply.answer(String(data=configuration)))
        bus.serve(keys.SIM_PAUSE, self.on_pause)
        bus.serve(keys.SIM_RESUME, self.on_resume)
        bus.serve(keys.SIM_STEP, self.on_step)
        bus.serve(keys.SIM_RESET, self.on_reset)
        bus.serve(keys.SIM_SPEED, self.on_speed)

    def reset(self, seed: int) -> None:
        """Put the robots back to the start, in a world made anew, and begin a run."""
        self.world = self.make_world()
        self.tick = 0
        self.stamp = Stamp(0, secrets.randbits(32), seed)
        for number, member in enumerate(self.members):
            member.reset(self.world, number, self.stamp)

    def make_world(self) -> World:
        """Return the world of a new run."""
        parts = [self.scenario.of(name) for name in self.scenario.names]
        robots = [(part.robot, part.start.pose) for part in parts]
        return World(robots, self.config, self.scenario.world)

    def run(self) -> None:
        """Wait until every service of the scenario is ready; then simulate until stopped."""
        self._await_services()
        self.begin()
        while True:
            self.step()

    def begin(self) -> None:
        """Publish the first state of a run."""
        self.schedule.restart(self.tick)
        self._publish()

    def step(self) -> None:
        """Wait for the answers to this tick, simulate one control period, publish the next.

        While time is held, it waits; where that would have no end, on the bus within a
        process, it returns and nothing has happened.
        """
        self.await_answers()
        if not self._hold():
            return
        if self.asked_reset is not None:
            self._reset_as_asked(*self.asked_reset)
            return
        commands = [member.end_tick() for member in self.members]
        self.world.advance(commands, self.steps_per_tick)
        self.tick += 1
        self.stamp = Stamp(self.tick * self.tick_ns, self.stamp.run, self.stamp.seed)
        for member in self.members:
            member.begin_tick(self.tick, self.stamp)
        self._publish()
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
        if self.lockstep or self.paused:
            self._await_all()
        elif self.tick == 0:
            # everybody's first answer takes longer, and is not owed yet: time begins with it
            self._await_all()
            self.schedule.restart(self.tick)
        else:
            self._await_due()

    def on_pause(self, request: Empty, reply: Reply[SimState]) -> None:
        """Hold simulated time at this tick."""
        del request
        self._end_stepping("paused meanwhile")
        self.paused = True
        reply.answer(self.sim_state())

    def on_resume(self, request: Empty, reply: Reply[SimState]) -> None:
        """Let simulated time go on."""
        del request
        self._end_stepping("resumed meanwhile")
        self.paused = False
        self.schedule.restart(self.tick)
        reply.answer(self.sim_state())

    def on_step(self, request: StepRequest, reply: Reply[SimState]) -> None:
        """Simulate some ticks while paused; the answer comes when they are done."""
        if not self.paused:
            reply.refuse("not paused: `sim/pause` first")
        elif self._at_the_end:
            reply.refuse("the run has ended: `sim/reset` begins it anew")
        elif self.steps_left:
            reply.refuse("still stepping")
        else:
            self.steps_left, self.step_reply = request.ticks, reply

    def on_reset(self, request: ResetRequest, reply: Reply[SimState]) -> None:
        """Ask for a reset, done between two ticks; the answer comes when it is done."""
        if self.asked_reset is not None:
            reply.refuse("already resetting")
        else:
            self.asked_reset = request, reply

    def on_speed(self, request: SpeedRequest, reply: Reply[SimState]) -> None:
        """Go on at another speed."""
        if self.lockstep:
            reply.refuse("lockstep goes as fast as it can: there is no speed to set")
            return
        self.schedule = Schedule(self.scenario.sim.tick_s, request.speed)
        self.schedule.restart(self.tick)
        reply.answer(self.sim_state())

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
        """Return the real-time factor, the deadlines that were missed, and where robots are."""
        values: dict[str, object] = {
            "mode": self.scenario.sim.mode,
            "rtf": round(self.schedule.rtf, 3),
            "missed_deadlines": self.missed_deadlines,
            "paused": self.paused,
        }
        for member in self.members:
            x, y, _ = member.robot.state().position
            values[member.join_key("x_m")] = round(x, 3)
            values[member.join_key("y_m")] = round(y, 3)
        return values

    @property
    def is_answered(self) -> bool:
        """Whether all answers to this tick have come."""
        return not any(member.awaited for member in self.members)

    @property
    def awaited(self) -> list[str]:
        """Services whose answer to this tick is still to come."""
        return [member.join_key(part) for member in self.members for part in sorted(member.awaited)]

    def _await_services(self) -> None:
        others = set(self.scenario.services) - {self.NAME}
        onlookers = set() if self.lockstep else others & set(OBSERVERS)
        missing = self._await_ready(others - onlookers, self.scenario.sim.answer_timeout_s)
        missing += self._await_ready(onlookers, OBSERVERS_S)
        if missing and self.lockstep:
            raise StepTimeoutError(f"not there to start with: {', '.join(missing)}")
        if missing:
            logger.warning("msg=%r", f"going on without {', '.join(missing)}")

    def _await_ready(self, names: set[str], timeout_s: float) -> list[str]:
        """Wait until services of each robot are ready, and return those that are not in time."""
        deadline = time.monotonic() + timeout_s
        while True:
            missing = [
                member.join_key(name)
                for member in self.members
                for name in sorted(names)
                if f"{name}/ready" not in member.bus.presence.names
            ]
            if not missing or (left_s := deadline - time.monotonic()) <= 0.0:
                return missing
            self.bus.spin_once(left_s)

    def _await_all(self) -> None:
        deadline = time.monotonic() + self.scenario.sim.answer_timeout_s
        while not self.is_answered and self.asked_reset is None:
            if self.bus.spin_once(PRESENCE_POLL_S):
                continue
            gone = [
                member.join_key(part) for member in self.members for part in sorted(member.gone)
            ]
            if self.lockstep and (gone or time.monotonic() > deadline):
                missing = ", ".join(gone or self.awaited)
                raise StepTimeoutError(
                    f"{missing} did not answer tick {self.tick} (t = {self.stamp.time_ns / 1e9} s)"
                )
            if not self.lockstep:
                return

    def _await_due(self) -> None:
        while self.asked_reset is None and not self.paused:
            wait_s = self.schedule.wait_s(self.tick, answered=self.is_answered)
            if wait_s <= 0.0:
                # what has arrived by now still counts, but a flood has no end
                for _ in range(ARRIVED_AT_MOST):
                    if self.is_answered or not self.bus.spin_once(0.0):
                        break
                break
            self.bus.spin_once(wait_s)
        if not self.is_answered and self.asked_reset is None and not self.paused:
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

    def _publish(self) -> None:
        if self.clock is not None:
            self.clock.put(Clock(clock=self.stamp.time), self.stamp)
        for member in self.members:
            member.publish()
        self.schedule.published(self.tick)
        if self.stamp.time_ns % NS_PER_S < self.tick_ns:
            self.publish_diagnostics()
