"""Physics: the robot in its world, and the owner of simulated time."""

from __future__ import annotations

import logging
import math
import secrets
import time
from operator import itemgetter

from mecazen import keys
from mecazen.bus import Bus, Reply
from mecazen.config import ONLOOKERS, Scenario, whole_ticks
from mecazen.description import RobotDescription, serve_description
from mecazen.errors import StepTimeoutError
from mecazen.geometry import Pose2D, Twist2D
from mecazen.loading import to_toml
from mecazen.messages import (
    Clock,
    Empty,
    Header,
    JointState,
    Odometry,
    Point,
    Pose,
    PoseWithCovariance,
    Quaternion,
    ResetRequest,
    SimState,
    SpeedRequest,
    StepRequest,
    String,
    Twist,
    TwistWithCovariance,
    Vector3,
)
from mecazen.robot import WHEEL_JOINTS, WHEELS
from mecazen.service import NS_PER_S, Service
from mecazen.wire import Stamp

from mecazen_physics.config import PhysicsConfig
from mecazen_physics.schedule import Schedule
from mecazen_physics.urdf import build_urdf, meshes
from mecazen_physics.world import World

logger = logging.getLogger(__name__)

ONLOOKERS_S = 1.0
"""In real time, how long onlookers may come after all others are ready and miss nothing."""
PRESENCE_POLL_S = 0.25
"""How long a missing answer may take before it is asked whether its service still lives."""

ARRIVED_AT_MOST = 100
"""Samples that are still taken when a tick is due: many more than make up a tick."""

FARTHEST_M = 1e6
"""Largest coordinate of a person: beyond it collisions are no numbers."""
FASTEST_M_S = 10.0
"""At most this fast a person pushes the robot, however fast they are said to be."""

SLOW_DOWN_S = 1.0
"""Over this time the wheels are brought to rest when their controller has gone."""


class PhysicsService(Service):
    """The robot with every roller, and simulated time: lockstep or real time.

    At every tick physics publishes `clock`, `joint_states` and `ground_truth/odom`, waits for
    the tick's `joint_command` and `target/odom`, and simulates the next control period.
    """

    NAME = "physics"
    PRIORITY = 1
    OWNS_TIME = True

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        self.config = scenario.section(PhysicsConfig, "physics")
        self.steps_per_tick = whole_ticks("sim.tick_s", scenario.sim.tick_s, self.config.dt_s)
        self.lockstep = scenario.sim.mode == "lockstep"
        self.answers = {"controller", "target"} & set(scenario.services)
        self.schedule = Schedule(scenario.sim.tick_s, scenario.sim.speed)
        self.paused = False
        self.steps_left = 0
        self.step_reply: Reply[SimState] | None = None
        self.asked_reset: tuple[ResetRequest, Reply[SimState]] | None = None
        self.missed_deadlines = 0
        self.clock = bus.publisher(keys.CLOCK)
        self.joint_states = bus.publisher(keys.JOINT_STATES)
        self.ground_truth = bus.publisher(keys.GROUND_TRUTH)
        super().__init__(bus, scenario)
        self.subscribe(keys.JOINT_COMMAND, self.on_joint_command)
        self.subscribe(keys.TARGET_ODOM, self.on_target_odom)
        bus.serve(keys.SIM_STATE, lambda _, reply: reply.answer(self.sim_state()))
        configuration = to_toml(scenario)
        bus.serve(keys.SIM_SCENARIO, lambda _, reply: reply.answer(String(data=configuration)))
        bus.serve(keys.SIM_PAUSE, self.on_pause)
        bus.serve(keys.SIM_RESUME, self.on_resume)
        bus.serve(keys.SIM_STEP, self.on_step)
        bus.serve(keys.SIM_RESET, self.on_reset)
        bus.serve(keys.SIM_SPEED, self.on_speed)
        serve_description(bus, RobotDescription(build_urdf(scenario.robot), meshes(scenario.robot)))

    def reset(self, seed: int) -> None:
        """Put the robot back to the start, in a world made anew, and begin a run."""
        self.world = self.make_world()
        self.tick = 0
        self.stamp = Stamp(0, secrets.randbits(32), seed)
        self.command: tuple[float, ...] = (0.0,) * len(WHEELS)
        self.last_command = self.command
        self.command_is_effort = False
        self.command_tick = 0
        self.walking: Pose2D | None = None
        """Where the person was said to be, as long as somebody says it again and again."""
        self.person_tick = 0
        self.awaited = set(self.answers)

    def make_world(self) -> World:
        """Return the world of a new run."""
        return World(self.scenario.robot, self.config, self.scenario.start.pose)

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
        self._stop_if_commands_are_gone()
        self._stop_person_if_gone()
        if self.command_is_effort:
            self.world.advance_effort(self.command, self.steps_per_tick)
        else:
            self.world.advance(self.command, self.steps_per_tick)
        self.tick += 1
        self.stamp = Stamp(self.tick * self.tick_ns, self.stamp.run, self.stamp.seed)
        self.awaited = set(self.answers)
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

    def on_joint_command(self, joints: JointState, stamp: Stamp | None) -> None:
        """Take velocities [rad/s] or efforts [N·m] of the wheels, by name."""
        if self._is_intrusion("controller", stamp):
            return
        efforts = bool(joints.effort) and not joints.velocity
        values = dict(zip(joints.name, joints.effort if efforts else joints.velocity, strict=False))
        try:
            self.command = _of_wheels(values)
        except KeyError:
            self.bus.refuse(
                keys.JOINT_COMMAND.key, f"needs a velocity or an effort of {WHEEL_JOINTS}"
            )
            return
        self.command_is_effort = efforts
        self.command_tick = self.tick
        if stamp is not None and stamp.time_ns == self.stamp.time_ns:
            self.awaited.discard("controller")

    def on_target_odom(self, person: Odometry, stamp: Stamp | None) -> None:
        """Place the person's body."""
        if self._is_intrusion("target", stamp):
            return
        pose, twist = person.pose.pose.to_planar(), person.twist.twist.to_planar()
        if max(abs(pose.x), abs(pose.y)) > FARTHEST_M:
            self.bus.refuse(keys.TARGET_ODOM.key, f"pose out of range: {tuple(pose)}")
            return
        slower = FASTEST_M_S / max(math.hypot(twist.x, twist.y), FASTEST_M_S)
        self.world.place_person(pose, Twist2D(twist.x * slower, twist.y * slower))
        self.walking, self.person_tick = pose, self.tick
        if stamp is not None and stamp.time_ns == self.stamp.time_ns:
            self.awaited.discard("target")

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
        """Return the real-time factor and the deadlines that were missed."""
        return {
            "mode": self.scenario.sim.mode,
            "rtf": round(self.schedule.rtf, 3),
            "missed_deadlines": self.missed_deadlines,
            "paused": self.paused,
        }

    def _await_services(self) -> None:
        others = set(self.scenario.services) - {self.NAME}
        onlookers = set() if self.lockstep else others & set(ONLOOKERS)
        missing = self._await_ready(others - onlookers, self.scenario.sim.answer_timeout_s)
        missing += self._await_ready(onlookers, ONLOOKERS_S)
        if missing and self.lockstep:
            raise StepTimeoutError(f"not there to start with: {', '.join(missing)}")
        if missing:
            logger.warning("msg=%r", f"going on without {', '.join(missing)}")

    def _await_ready(self, names: set[str], timeout_s: float) -> list[str]:
        """Wait until services are ready, and return those that are not in time."""
        deadline = time.monotonic() + timeout_s
        while True:
            missing = [n for n in sorted(names) if f"{n}/ready" not in self.bus.presence.names]
            if not missing or (left_s := deadline - time.monotonic()) <= 0.0:
                return missing
            self.bus.spin_once(left_s)

    def _await_all(self) -> None:
        deadline = time.monotonic() + self.scenario.sim.answer_timeout_s
        while self.awaited and self.asked_reset is None:
            if self.bus.spin_once(PRESENCE_POLL_S):
                continue
            gone = self.awaited - self.bus.presence.names
            if self.lockstep and (gone or time.monotonic() > deadline):
                missing = ", ".join(sorted(gone or self.awaited))
                raise StepTimeoutError(
                    f"{missing} did not answer tick {self.tick} (t = {self.stamp.time_ns / 1e9} s)"
                )
            if not self.lockstep:
                return

    def _await_due(self) -> None:
        while self.asked_reset is None and not self.paused:
            wait_s = self.schedule.wait_s(self.tick, answered=not self.awaited)
            if wait_s <= 0.0:
                # what has arrived by now still counts, but a flood has no end
                for _ in range(ARRIVED_AT_MOST):
                    if not (self.awaited and self.bus.spin_once(0.0)):
                        break
                break
            self.bus.spin_once(wait_s)
        if self.awaited and self.asked_reset is None and not self.paused:
            self.missed_deadlines += 1

    def _is_intrusion(self, name: str, stamp: Stamp | None) -> bool:
        """Return whether an outsider speaks in lockstep for a service that takes part."""
        return self.lockstep and stamp is None and name in self.answers

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

    def _stop_if_commands_are_gone(self) -> None:
        """Let the wheels slow down to rest when nobody commands them any more."""
        silent_s = (self.tick - self.command_tick) * self.scenario.sim.tick_s
        if silent_s <= self.config.watchdog_s:
            self.last_command = self.command
            return
        if self.command_is_effort:
            self.last_command = tuple(self.world.state().joint_velocity[: len(WHEELS)])
            self.command_is_effort = False
        left = max(0.0, 1.0 - (silent_s - self.config.watchdog_s) / SLOW_DOWN_S)
        self.command = tuple(speed * left for speed in self.last_command)

    def _stop_person_if_gone(self) -> None:
        """Let the person stand where they were last said to be, when nobody says more."""
        silent_s = (self.tick - self.person_tick) * self.scenario.sim.tick_s
        if self.walking is not None and silent_s > self.config.watchdog_s:
            self.world.place_person(self.walking, Twist2D())
            self.walking = None

    def _publish(self) -> None:
        state = self.world.state()
        stamp, now = self.stamp, self.stamp.time
        self.clock.put(Clock(clock=now), stamp)
        self.joint_states.put(
            JointState(
                header=Header(stamp=now, frame_id="base_link"),
                name=self.world.joint_names,
                position=tuple(state.joint_position),
                velocity=tuple(state.joint_velocity),
                effort=tuple(state.joint_effort),
            ),
            stamp,
        )
        x, y, z = state.position
        qx, qy, qz, qw = state.orientation
        self.ground_truth.put(
            Odometry(
                header=Header(stamp=now, frame_id="world"),
                child_frame_id="base_link",
                pose=PoseWithCovariance(
                    pose=Pose(
                        position=Point(x=x, y=y, z=z),
                        orientation=Quaternion(x=qx, y=qy, z=qz, w=qw),
                    )
                ),
                twist=TwistWithCovariance(
                    twist=Twist(linear=_vector(state.linear), angular=_vector(state.angular))
                ),
            ),
            stamp,
        )
        self.schedule.published(self.tick)
        if stamp.time_ns % NS_PER_S < self.tick_ns:
            self.publish_diagnostics()


_of_wheels = itemgetter(*WHEEL_JOINTS)
"""Takes the four wheels' values, in their order, from those of any joints by name."""


def _vector(values: tuple[float, float, float]) -> Vector3:
    return Vector3(x=values[0], y=values[1], z=values[2])
