"""Simulated time: what advances, holds, steps and resets a world, its schedule, and its pace."""

import harness
import msgspec
import pytest
from carts import Carts
from harness import load_robot, wait
from mecazen import keys
from mecazen import messages as m
from mecazen.bus import Bus, StoppedError
from mecazen.config import RobotConfig, Scenario, SimConfig, StartConfig
from mecazen.errors import BusError, MecazenError
from mecazen.loading import to_toml
from mecazen.runtime.pace import (
    TICKS_APART,
    Pace,
    announce_readiness,
    declare_every,
    serve_every,
)
from mecazen.wire import Stamp

TICK_NS = 10_000_000
ALL = ("physics", "controller", "target", "follower")
ALONE = ("physics",)
STATES = (keys.CLOCK, keys.JOINT_STATES, keys.GROUND_TRUTH)


class Answer:
    """A reply that may come later than the request."""

    message = error = None

    def answer(self, message):
        assert self.message is self.error is None
        self.message = message

    def refuse(self, reason):
        assert self.message is self.error is None
        self.error = reason


class Rig(harness.Rig):
    """The clock at the first tick of a run; the test answers its ticks."""

    def __init__(self, services=ALL, begin=True, **sim):
        sim = SimConfig(**{"mode": "lockstep", "answer_timeout_s": 1e-3, **sim})
        scenario = Scenario(load_robot(), services, seed=3, sim=sim)
        super().__init__("physics", scenario, *STATES, kinds={"physics": Carts})
        self.clock = self.driver
        for part in services:
            self.bus.declare_alive(part)
        if begin:
            self.clock.begin()

    def answer(self, *parts, stamp=None):
        """Answer the tick for the controller, the target or both."""
        for part in parts or ("controller", "target"):
            topic = keys.JOINT_COMMAND if part == "controller" else keys.TARGET_ODOM
            message = m.JointState(velocity=(1.0,)) if part == "controller" else m.Odometry()
            self.bus.publisher(topic).put(message, stamp or self.clock.stamp)

    def tick(self, *parts):
        """Answer the tick for services; return the samples of the next tick."""
        self.answer(*parts)
        self.clock.step()
        return self.samples.take()

    def ask(self, call, request):
        """Query a key that is answered later."""
        answer = Answer()
        self.bus.server(call)(request, answer)
        return answer


def x_of(samples):
    """Return where the robot is by its last sample [m]."""
    return samples[-1].message.pose.pose.position.x


def values_of(sample):
    return {pair.key: pair.value for pair in sample.message.status[0].values}


def test_each_tick_is_published_and_moved_by_its_answers():
    rig = Rig()
    samples = rig.samples.take()
    for tick in range(3):
        assert [sample.key for sample in samples] == [topic.key for topic in STATES]
        stamp = Stamp(tick * TICK_NS, rig.clock.stamp.run, 3)
        assert {sample.stamp for sample in samples} == {stamp}
        assert samples[0].message == m.Clock(clock=m.Time(nanosec=tick * TICK_NS))
        # at 1 m/s from the first answer on; a sum of ticks, not a product
        assert x_of(samples) == pytest.approx(0.01 * tick, rel=1e-12)
        samples = rig.tick()
    assert rig.clock.missed_deadlines == 0


@pytest.mark.parametrize("alive", [True, False])
def test_in_lockstep_a_silent_service_is_an_error(alive):
    rig = Rig(answer_timeout_s=1e6)  # within one process no wait could be answered
    rig.tick()
    rig.answer("target", stamp=rig.clock.stamp._replace(time_ns=0))  # to another tick
    rig.bus.presence.update("target", alive=alive)
    with pytest.raises(MecazenError, match=r"^target did not answer tick 1 \(t = 0.01 s\)$"):
        rig.tick("controller")


def test_in_real_time_a_run_begins_without_observers(monkeypatch, caplog, wall):
    wall.step_s = 1e-4  # it advances with each reading
    monkeypatch.setattr("mecazen.runtime.clock.OBSERVERS_S", 0.0)
    rig = Rig(("physics", "controller", "recorder"), begin=False, mode="real_time")
    ticks = []
    rig.bus.subscribe(keys.CLOCK, lambda _, stamp: ticks.append(stamp))
    rig.bus.subscribe(keys.CLOCK, lambda *_: rig.bus.stop() if len(ticks) == 5 else None)
    with pytest.raises(StoppedError):
        rig.clock.run()
    assert len(ticks) == 5
    assert "going on without controller, recorder" in caplog.text


def test_pause_holds_time_until_resume():
    rig = Rig()
    rig.tick()
    paused = rig.bus.call(keys.SIM_PAUSE, m.Empty())
    assert (paused.paused, paused.tick, paused.clock) == (True, 1, m.Time(nanosec=TICK_NS))
    assert (paused.speed, paused.mode, paused.seed) == (1.0, "lockstep", 3)
    assert rig.bus.call(keys.SIM_SCENARIO, m.Empty()).data == to_toml(rig.scenario)
    assert [rig.tick(), rig.tick()] == [[], []]  # no event can end the pause, so it does not wait
    assert rig.bus.call(keys.SIM_STATE, m.Empty()) == paused
    # a query that arrives within the step ends the pause
    rig.bus.subscribe(keys.CMD_VEL, lambda *_: rig.bus.call(keys.SIM_RESUME, m.Empty()) and None)
    rig.bus.publisher(keys.CMD_VEL).put(m.Twist(), rig.clock.stamp)
    assert rig.tick()[0].message.clock == m.Time(nanosec=2 * TICK_NS)


def test_stepping_makes_a_number_of_ticks_but_none_after_the_last():
    rig = Rig(ALONE, duration_s=0.06)
    assert rig.ask(keys.SIM_STEP, m.StepRequest()).error == "not paused: `mecazen sim pause` first"
    rig.bus.call(keys.SIM_PAUSE, m.Empty())
    stepping = rig.ask(keys.SIM_STEP, m.StepRequest(ticks=3))
    assert rig.ask(keys.SIM_STEP, m.StepRequest()).error == "still stepping"
    assert [len(rig.tick()) for _ in range(2)] == [6, 3]
    assert stepping.message is None
    assert [len(rig.tick()) for _ in range(2)] == [3, 0]
    assert (stepping.message.tick, stepping.message.paused) == (3, True)
    to_the_end = rig.ask(keys.SIM_STEP, m.StepRequest(ticks=100))
    assert [len(rig.tick()) for _ in range(3)] == [3, 3, 0]
    assert to_the_end.message.tick == 5
    late = rig.ask(keys.SIM_STEP, m.StepRequest())
    assert late.error == "the run has ended: `mecazen sim reset` begins another"
    rig.bus.call(keys.SIM_RESUME, m.Empty())
    assert rig.tick() == []


@pytest.mark.parametrize(
    ("call", "reason"),
    [(keys.SIM_PAUSE, "paused"), (keys.SIM_RESUME, "resumed"), (keys.SIM_RESET, "reset")],
)
def test_a_query_that_ends_stepping_is_its_reason(call, reason):
    rig = Rig(ALONE)
    rig.bus.call(keys.SIM_PAUSE, m.Empty())
    stepping = rig.ask(keys.SIM_STEP, m.StepRequest(ticks=1000))
    rig.tick()
    asked = rig.ask(call, call.request())
    rig.tick()
    assert stepping.error == f"{reason} meanwhile"
    assert (asked.message.paused, asked.message.seed) == (call is not keys.SIM_RESUME, 3)


@pytest.mark.parametrize("answers", [("controller", "target"), ("target",)])
def test_a_reset_begins_a_run_even_if_an_answer_is_missing(answers):
    rig = Rig()
    rig.tick()
    old = rig.clock.stamp
    reset = rig.ask(keys.SIM_RESET, m.ResetRequest(seed=8))
    assert rig.ask(keys.SIM_RESET, m.ResetRequest()).error == "already resetting"
    samples = rig.tick(*answers)
    assert (reset.message.tick, reset.message.seed, reset.message.clock) == (0, 8, m.Time())
    assert samples[0].stamp == rig.clock.stamp == Stamp(0, rig.clock.stamp.run, 8)
    assert rig.clock.stamp.run != old.run
    assert x_of(samples) == 0.0
    rig.answer(stamp=old)  # late, to the run before
    with pytest.raises(MecazenError, match=r"^target did not answer tick 0"):
        rig.clock.step()


def test_health_has_the_clock_and_the_world_once_a_second():
    rig = Rig(ALONE)
    for _ in range(200):
        rig.tick()
    reports = rig.health.take()
    assert [sample.message.header.stamp for sample in reports] == [m.Time(n) for n in range(3)]
    expected = {"mode": "lockstep", "missed_deadlines": "0", "paused": "False"}
    expected |= {"age_s": "inf", "missed_ticks": "0", "refused_payloads": "0"}
    assert values_of(reports[0]) == expected  # without a real-time factor, of the last second
    later = values_of(reports[1])
    assert {"hz/joint_command", "age_s/target/odom"} <= later.keys()
    assert float(later["rtf"]) > 0.0


def test_in_real_time_a_tick_ends_when_it_is_due(wall):
    wall.step_s = 1e-4  # it advances with each reading
    rig = Rig(("physics", "controller"), mode="real_time", speed=2.0)
    for speed, seconds in ((2.0, 0.1), (0.5, 0.4)):
        assert rig.bus.call(keys.SIM_SPEED, m.SpeedRequest(speed=speed)).speed == speed
        begin = wall.now
        for _ in range(20):
            rig.tick("controller")
        # half a tick of readings of the clock
        assert wall.now - begin == pytest.approx(seconds, abs=0.005)
    assert rig.clock.missed_deadlines == 0
    for _ in range(2):  # the last command holds
        rig.clock.step()
    assert x_of(rig.samples.take()) == pytest.approx(0.42)
    assert rig.bus.call(keys.SIM_STATE, m.Empty()).missed_deadlines == 2
    reset = rig.ask(keys.SIM_RESET, m.ResetRequest())
    rig.tick("controller")
    assert reset.message.missed_deadlines == 0
    with pytest.raises(BusError, match="as fast as it can"):
        Rig(ALONE).bus.call(keys.SIM_SPEED, m.SpeedRequest(speed=4.0))


PATIENCE_S = 0.2


@pytest.fixture
def pace(zenoh_pair):
    """The pace of a clock, which knows a recorder on the pair's near bus."""
    declare_every(zenoh_pair.near, "recorder", "two")
    zenoh_pair.link()
    wait(zenoh_pair.far, lambda: "two/recorder/every" in zenoh_pair.far.presence.names)
    return Pace(zenoh_pair.far, PATIENCE_S)


def test_the_clock_continues_without_a_silent_service_and_waits_for_it_again(
    zenoh_pair, pace, caplog
):
    for tick in range(2 * TICKS_APART + 1):
        pace.keep(tick)
    assert caplog.messages == ["msg='going on without two/recorder, silent: samples may be lost'"]
    with zenoh_pair.serving():
        pace.keep(TICKS_APART)
    pace.keep(TICKS_APART)
    assert len(caplog.messages) == 2


class LossyBus(Bus):
    """Every second call ends without an answer, as a peer's may while links change."""

    count = 0

    def call(self, call, request, timeout_s=10.0):
        self.count += 1
        if self.count % 2:
            raise BusError(f"{call.key}: nobody answers")
        return super().call(call, request, timeout_s)


def test_the_clock_asks_a_live_service_again(caplog):
    bus = LossyBus()
    declare_every(bus, "recorder")
    serve_every(bus, "target")
    bus.declare_alive("target")
    pace = Pace(bus, PATIENCE_S)
    pace.keep(TICKS_APART)
    pace.confirm(["target"])
    assert bus.count == 4
    assert not caplog.records
    with pytest.raises(BusError, match="follower/every: nobody answers"):
        pace.confirm(["follower"])


@pytest.mark.parametrize(
    ("mode", "services", "awaited"),
    [
        ("real_time", ("target", "recorder"), ["target"]),
        ("lockstep", ("recorder", "viewer"), ["recorder", "viewer"]),
    ],
)
def test_a_service_is_ready_when_all_others_are_alive(scenario, mode, services, awaited):
    bus, services = Bus(), ("controller", *services)
    scenario = msgspec.structs.replace(scenario, services=services, sim=SimConfig(mode=mode))
    announce_readiness(bus, "controller", "", scenario)
    for name in ("stranger", *awaited):
        assert "controller/ready" not in bus.presence.names
        bus.declare_alive(name)
    assert bus.presence.names == {"controller/ready", *awaited}


def test_a_robots_service_waits_for_those_of_all_robots(scenario):
    bus = Bus()
    robots = (RobotConfig("one"), RobotConfig("two", start=StartConfig(y_m=2.0)))
    scenario = msgspec.structs.replace(scenario, services=("target",), robots=robots)
    announce_readiness(bus, "target", "one", scenario)
    assert not bus.presence.names
    bus.declare_alive("target", "two")
    assert bus.presence.names == {"two/target", "one/target/ready"}
