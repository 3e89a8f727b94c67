"""Simulated time: what advances a world, holds, steps and resets it."""

import tomllib
from pathlib import Path

import pytest
from carts import ALONE, STATES, Rig, state, x_of
from harness import Listener, error_of, load_robot
from mecazen import keys
from mecazen import messages as m
from mecazen.bus import StoppedError
from mecazen.errors import BusError, StepTimeoutError
from mecazen.geometry import Pose2D
from mecazen.keys import call_of_robot
from mecazen.loading import from_tables, to_toml
from mecazen.messages import Clock, Empty, ResetRequest, SpeedRequest, StepRequest, Time, Twist
from mecazen.node import Node
from mecazen.row import Row, due, every
from mecazen.wire import Stamp

TICK_NS = 10_000_000


@pytest.fixture
def wall(wall):
    """Return a wall clock for the schedule that advances a little with each reading."""
    wall.step_s = 1e-4
    return wall


def test_each_tick_is_published_with_its_stamp_and_moved_by_its_answers():
    rig = Rig()
    heard = rig.take()
    for tick in range(3):
        assert [sample.key for sample in heard] == [topic.key for topic in STATES]
        assert {sample.stamp for sample in heard} == {Stamp(tick * TICK_NS, rig.clock.stamp.run, 3)}
        assert heard[0].message == Clock(clock=Time(nanosec=tick * TICK_NS))
        # at 1 m/s from the first answer on; a sum of ticks, not a product
        assert x_of(heard) == pytest.approx(0.01 * tick, rel=1e-12)
        heard = rig.tick()
    assert rig.clock.missed_deadlines == 0


@pytest.mark.parametrize(
    ("silent", "gone"), [("controller", False), ("target", False), ("target", True)]
)
def test_in_lockstep_a_silent_service_is_an_error_that_names_it_at_once_if_it_has_gone(
    silent, gone
):
    rig = Rig(answer_timeout_s=1e6)  # within one process no wait could be answered
    rig.tick()
    rig.answer(silent, stamp=rig.clock.stamp._replace(time_ns=0))  # to another tick
    rig.bus.presence.update(silent, alive=not gone)
    with pytest.raises(StepTimeoutError, match=rf"^{silent} did not answer tick 1 \(t = 0.01 s\)$"):
        rig.tick("target" if silent == "controller" else "controller")


def test_to_begin_with_all_services_must_be_there():
    rig = Rig(begin=False)
    with pytest.raises(StepTimeoutError, match=r"^not there to start with: .*"):
        rig.clock.run()
    for name in ("controller", "follower"):
        rig.bus.declare_alive(f"{name}/ready")
    with pytest.raises(StepTimeoutError, match=r"^not there to start with: target$"):
        rig.clock.run()


def test_in_real_time_a_run_begins_without_observers_and_ends_with_the_bus(
    monkeypatch, caplog, wall
):
    monkeypatch.setattr("mecazen.runtime.clock.OBSERVERS_S", 0.0)
    rig = Rig(("physics", "controller", "recorder"), begin=False, mode="real_time")
    ticks = []
    rig.bus.subscribe(keys.CLOCK, lambda _, stamp: ticks.append(stamp))
    rig.bus.subscribe(keys.CLOCK, lambda *_: rig.bus.stop() if len(ticks) == 5 else None)
    with pytest.raises(StoppedError):
        rig.clock.run()
    assert len(ticks) == 5
    assert "going on without controller, recorder" in caplog.text


def test_in_lockstep_an_outsider_can_not_speak_for_a_service_that_takes_part():
    rig = Rig()
    rig.bus.put_bytes("joint_command", b'{"velocity":[9]}')
    rig.bus.put_bytes("target/odom", b"{}")
    with pytest.raises(StepTimeoutError, match=r"^target did not answer tick 0"):
        rig.clock.step()
    assert x_of(rig.tick()) == 0.01
    alone = Rig(ALONE)
    alone.bus.put_bytes("joint_command", b'{"velocity":[9]}')
    alone.take()
    alone.clock.step()
    assert x_of(alone.take()) == 0.09


def test_pause_holds_time_and_resume_lets_it_go_on():
    rig = Rig()
    rig.tick()
    paused = rig.bus.call(keys.SIM_PAUSE, Empty())
    assert (paused.paused, paused.tick, paused.clock) == (True, 1, Time(nanosec=TICK_NS))
    assert (paused.speed, paused.mode, paused.seed) == (1.0, "lockstep", 3)
    assert [rig.tick(), rig.tick()] == [[], []]  # no event can end the pause, so it does not wait
    assert rig.bus.call(keys.SIM_STATE, Empty()) == paused
    # what is on its way ends the pause within the step
    rig.bus.subscribe(keys.CMD_VEL, lambda *_: rig.bus.call(keys.SIM_RESUME, Empty()) and None)
    rig.bus.publisher(keys.CMD_VEL).put(Twist(), rig.clock.stamp)
    assert rig.tick()[0].message.clock == Time(nanosec=2 * TICK_NS)


def test_step_simulates_so_many_ticks_and_answers_when_they_are_done():
    rig = Rig()
    assert rig.ask(keys.SIM_STEP, StepRequest()).error == "not paused: `mecazen sim pause` first"
    rig.bus.call(keys.SIM_PAUSE, Empty())
    stepping = rig.ask(keys.SIM_STEP, StepRequest(ticks=3))
    assert rig.ask(keys.SIM_STEP, StepRequest()).error == "still stepping"
    assert [len(rig.tick()) for _ in range(2)] == [6, 3]
    assert stepping.message is None
    assert [len(rig.tick()) for _ in range(2)] == [3, 0]
    assert (stepping.message.tick, stepping.message.paused) == (3, True)


def test_a_lockstep_run_ends_with_its_last_tick_whatever_steps_are_asked_for():
    rig = Rig(ALONE, duration_s=0.04)
    assert [len(rig.tick()) for _ in range(2)] == [6, 3]
    rig.bus.call(keys.SIM_PAUSE, Empty())
    stepping = rig.ask(keys.SIM_STEP, StepRequest(ticks=100))
    assert [len(rig.tick()) for _ in range(2)] == [3, 0]
    assert stepping.message.tick == 3
    late = rig.ask(keys.SIM_STEP, StepRequest())
    assert late.error == "the run has ended: `mecazen sim reset` begins another"
    rig.bus.call(keys.SIM_RESUME, Empty())
    assert rig.tick() == []


@pytest.mark.parametrize(
    ("call", "request_", "reason"),
    [
        (keys.SIM_PAUSE, Empty(), "paused meanwhile"),
        (keys.SIM_RESUME, Empty(), "resumed meanwhile"),
        (keys.SIM_RESET, ResetRequest(), "reset meanwhile"),
    ],
)
def test_what_ends_the_stepping_says_so(call, request_, reason):
    rig = Rig(ALONE)
    rig.bus.call(keys.SIM_PAUSE, Empty())
    stepping = rig.ask(keys.SIM_STEP, StepRequest(ticks=1000))
    rig.tick()
    asked = rig.ask(call, request_)
    rig.tick()
    assert stepping.error == reason
    assert (asked.message.paused, asked.message.seed) == (call is not keys.SIM_RESUME, 3)


@pytest.mark.parametrize("answers", [("controller", "target"), ("target",)])
def test_a_reset_in_place_is_a_new_run_even_where_an_answer_is_missing(answers):
    rig = Rig()
    rig.tick()
    old = rig.clock.stamp
    reset = rig.ask(keys.SIM_RESET, ResetRequest(seed=8))
    assert rig.ask(keys.SIM_RESET, ResetRequest()).error == "already resetting"
    heard = rig.tick(*answers)
    assert (reset.message.tick, reset.message.seed, reset.message.clock) == (0, 8, Time())
    assert heard[0].stamp == rig.clock.stamp == Stamp(0, rig.clock.stamp.run, 8)
    assert rig.clock.stamp.run != old.run
    assert x_of(heard) == 0.0
    # a late answer of the run before is ignored
    rig.answer(stamp=old)
    with pytest.raises(StepTimeoutError, match=r"^target did not answer tick 0"):
        rig.clock.step()


def test_the_whole_configuration_is_there_to_be_asked_for():
    rig = Rig()
    text = rig.bus.call(keys.SIM_SCENARIO, Empty()).data
    assert text == to_toml(rig.scenario)
    assert from_tables(tomllib.loads(text), Path("asked")).robot == load_robot()


def test_health_comes_once_a_second_with_the_words_of_the_world():
    rig = Rig(ALONE)
    for _ in range(200):
        rig.tick()
    said = [sample.message for sample in rig.health.take()]
    assert [message.header.stamp for message in said] == [Time(second) for second in range(3)]
    # no real-time factor before the first second
    expected = {"mode": "lockstep", "missed_deadlines": "0", "paused": "False"}
    expected |= {"age_s": "inf", "missed_ticks": "0", "refused_payloads": "0"}
    assert {value.key: value.value for value in said[0].status[0].values} == expected
    later = {value.key: value.value for value in said[1].status[0].values}
    assert {"hz/joint_command", "age_s/target/odom"} <= later.keys()
    assert float(later["rtf"]) > 0.0


def test_in_real_time_a_tick_ends_when_it_is_due_and_counts_what_was_missed(wall):
    rig = Rig(("physics", "controller"), mode="real_time")
    begin = wall.now
    for _ in range(20):
        rig.tick("controller")
    assert wall.now - begin == pytest.approx(0.2, abs=0.005)  # half a tick of looks at the clock
    assert rig.clock.missed_deadlines == 0
    for _ in range(2):  # the last command holds
        rig.clock.step()
    assert x_of(rig.take()) == pytest.approx(0.22)
    assert rig.bus.call(keys.SIM_STATE, Empty()).missed_deadlines == 2
    anew = rig.ask(keys.SIM_RESET, ResetRequest())
    rig.tick("controller")
    assert anew.message.missed_deadlines == 0


@pytest.mark.parametrize(
    ("patience_s", "alive", "missed"), [(1e6, True, 0), (1e6, False, 1), (0.0, True, 1)]
)
def test_in_real_time_time_starts_once_the_first_answers_have_come_or_can_not(
    monkeypatch, patience_s, alive, missed
):
    rig = Rig(("physics", "controller"), mode="real_time", answer_timeout_s=patience_s)
    rig.bus.presence.update("controller", alive=alive)
    deliveries = [rig.answer, None, None]  # two waits in which nothing comes

    def deliver(timeout_s=None):
        delivery = deliveries.pop()
        if delivery is None:
            return False
        delivery("controller")
        return True

    monkeypatch.setattr(rig.bus, "spin_once", deliver)
    rig.clock._await_answers()
    assert bool(deliveries) == bool(missed)
    assert rig.clock.missed_deadlines == missed


def test_at_twice_the_speed_a_tick_takes_half_the_time_and_lockstep_has_none(wall):
    rig = Rig(ALONE, mode="real_time", speed=2.0)
    for speed, seconds in ((2.0, 0.1), (0.5, 0.4)):
        assert rig.bus.call(keys.SIM_SPEED, SpeedRequest(speed=speed)).speed == speed
        begin = wall.now
        for _ in range(20):
            rig.tick()
        assert wall.now - begin == pytest.approx(seconds, abs=0.005)
    assert rig.clock.missed_deadlines == 0
    with pytest.raises(BusError, match="as fast as it can"):
        Rig(ALONE).bus.call(keys.SIM_SPEED, SpeedRequest(speed=4.0))


class Playback(Node):
    """A recording as a world: it waits for the follower and obeys no command."""

    ROW = Row(
        "playback",
        inputs=(every(keys.CLOCK), due(keys.CMD_VEL, before=True)),
        outputs=(keys.JOINT_STATES, keys.GROUND_TRUTH),
    )
    POSES = (Pose2D(), Pose2D(1.0, 0.5), Pose2D(2.0, 1.0, 0.5))

    def reset(self, seed):
        self.poses = dict(enumerate(self.POSES))

    def step(self, tick, inputs):
        return state(tick, self.poses[tick.number])


def test_a_recording_as_a_world_waits_for_whom_its_row_names():
    rig = Rig(kind=Playback, programs={"physics": "playback.py:Playback"})
    heard = rig.take()
    for tick, pose in enumerate(Playback.POSES):
        assert heard[0].message.clock == Time(nanosec=tick * TICK_NS)
        assert heard[2].message.pose.pose.to_planar() == pytest.approx(pose)
        if tick < 2:
            with pytest.raises(StepTimeoutError, match=f"^follower did not answer tick {tick}"):
                rig.tick()  # for controller and target
            rig.bus.publisher(keys.CMD_VEL).put(Twist(), rig.clock.stamp)
            rig.clock.step()
            heard = rig.take()


def test_a_change_is_published_before_its_tick_and_then_each_second():
    rig = Rig(ALONE, begin=False)
    heard = Listener(rig.bus, keys.PARAMETERS, keys.CLOCK)
    rig.clock.begin()
    rig.tick()
    rig.clock.live._requested = {"follower.standoff_m": 2.0}
    assert [sample.key for sample in heard.take()] == ["clock"] * 2
    rig.tick()
    first, clock = heard.take()
    assert first.key == "sim/parameters"
    assert first.stamp == clock.stamp
    assert first.message.parameters == (m.Parameter("follower.standoff_m", "2.0"),)
    for _ in range(99):
        rig.tick()
    again = [sample for sample in heard.take() if sample.key == "sim/parameters"]
    assert [sample.message.parameters for sample in again] == [first.message.parameters]
    rig.bus.declare_alive("late")
    assert [sample.message.parameters for sample in heard.take()] == [first.message.parameters]


@pytest.mark.parametrize("call", [keys.GET_PARAMETERS, keys.SET_PARAMETERS])
def test_without_parameters_there_is_nothing_to_get_or_set(call):
    rig = Rig(ALONE)
    name = "mine.reach_m"
    one = m.Parameters(parameters=(m.Parameter(name, "1"),))
    request = one if call is keys.SET_PARAMETERS else m.ParameterNames((name,))
    line = error_of(BusError, lambda: rig.bus.call(call, request))
    assert line == f"{call.key}: {name}: no such parameter; `mecazen param list` shows all"
    assert rig.bus.call(keys.GET_PARAMETERS, m.ParameterNames()) == m.ParameterDescriptors()


TWO = (("physics", "controller", "target"), "one", "two")


def test_each_robot_moves_in_its_namespace_and_all_samples_of_a_tick_have_one_stamp():
    rig = Rig(*TWO)
    shared = Listener(rig.bus, keys.CLOCK)
    for name in ("one", "two"):
        for part, speed in (("controller", 1.0 if name == "one" else 0.5), ("target", 0.0)):
            rig.answer(part, name=name, speed=speed)
    rig.clock.step()
    for name, x in (("one", 0.01), ("two", 0.005)):
        heard = rig.take(name)[-3:]
        assert {sample.stamp for sample in heard} == {Stamp(TICK_NS, rig.clock.stamp.run, 3)}
        assert x_of(heard) == x
    assert [sample.stamp for sample in shared.take()][-1] == rig.clock.stamp


def test_time_is_asked_for_in_no_ones_namespace_and_the_robot_in_each():
    rig = Rig(*TWO)
    assert rig.bus.call(keys.SIM_STATE, Empty()).seed == 3
    assert rig.bus.call(call_of_robot(keys.ROBOT_DESCRIPTION, "one"), Empty()).data == "<robot one>"
    with pytest.raises(BusError, match=r"^two/robot_description: shy"):
        rig.bus.call(call_of_robot(keys.ROBOT_DESCRIPTION, "two"), Empty())
    assert list(rig.bus.fetch_files("two/robot_description/*").values()) == [b"two"]


def test_its_health_tells_robots_apart():
    rig = Rig(*TWO)
    rig.bus.put_bytes("one/joint_command", b"{")
    for alive in (False, True):
        rig.bus.presence.update("two/target", alive=alive)
    for _ in range(100):
        rig.tick()
    report = rig.health.take()[-1].message
    said = {value.key: value.value for value in report.status[0].values}
    assert said["hz/one/joint_command"] == said["hz/two/target/odom"] == "100.0"
    assert said["refused/one/joint_command"] == said["restarts/two/target"] == "1"
