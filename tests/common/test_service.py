"""What every service gets from its base: runs, ticks, and its health once a second."""

import pytest
from mecazen import keys
from mecazen.bus import LocalBus
from mecazen.messages import Clock, DiagnosticArray, JointState, KeyValue, Time, Twist, Vector3
from mecazen.service import Service
from mecazen.wire import Stamp

TICK_NS = 10_000_000


class Toy(Service):
    """Writes down what it is told, and by which seed it began."""

    NAME = "toy"

    def __init__(self, bus, scenario):
        self.events = []
        super().__init__(bus, scenario)
        self.subscribe(keys.CLOCK, lambda *_: None)
        self.subscribe(keys.CMD_VEL, self.on_cmd_vel)
        self.answer_every_tick(keys.JOINT_STATES, self.on_joint_states)

    def reset(self, seed):
        self.events.append(("reset", seed))

    def on_cmd_vel(self, twist, stamp):
        self.events.append(("cmd_vel", twist.linear.x, stamp))

    def on_joint_states(self, joints, stamp):
        self.events.append(("joints", self.tick_of(stamp)))

    def diagnostics(self):
        return {"events": len(self.events)}


class Timekeeper(Toy):
    NAME = "timekeeper"
    OWNS_TIME = True


@pytest.fixture
def bus():
    return LocalBus()


@pytest.fixture
def toy(bus, scenario):
    toy = Toy(bus, scenario)
    assert toy.events == [("reset", 5)]
    toy.events.clear()
    return toy


@pytest.fixture
def put(bus):
    def put(topic, message, stamp):
        bus.publisher(topic).put(message, stamp)
        bus.spin()

    return put


def forward(speed):
    return Twist(linear=Vector3(x=speed))


def at(tick, run=1, seed=9):
    return Stamp(tick * TICK_NS, run, seed)


def test_a_new_run_resets_with_its_seed_before_its_first_sample(toy, put):
    put(keys.CMD_VEL, forward(0.1), at(0, run=1, seed=9))
    put(keys.CMD_VEL, forward(0.2), at(1, run=1, seed=9))
    put(keys.CMD_VEL, forward(0.3), at(0, run=2, seed=10))
    assert toy.events == [
        ("reset", 9),
        ("cmd_vel", 0.1, at(0)),
        ("cmd_vel", 0.2, at(1)),
        ("reset", 10),
        ("cmd_vel", 0.3, at(0, run=2, seed=10)),
    ]


def test_any_sample_that_is_heard_begins_a_run(toy, put):
    put(keys.CLOCK, Clock(), at(0))
    assert toy.events == [("reset", 9)]


def test_what_is_left_of_an_ended_run_is_dropped(toy, put):
    for run in (1, 2, 3):
        put(keys.CLOCK, Clock(), at(0, run=run))
    toy.events.clear()
    for run in (0, 1, 2):
        put(keys.CMD_VEL, forward(0.1), at(100, run=run))
        put(keys.JOINT_STATES, JointState(), at(100, run=run))
    assert toy.events == []
    assert toy.stamp == at(0, run=3)


def test_an_outsiders_sample_has_no_stamp_and_is_of_any_run(toy, bus, put):
    put(keys.CLOCK, Clock(), at(7))
    toy.events.clear()
    bus.put_bytes("cmd_vel", b'{"linear":{"x":0.2}}')
    bus.spin()
    assert toy.events == [("cmd_vel", 0.2, None)]
    assert toy.stamp == at(7)


def test_a_key_that_does_not_tell_time_can_not_end_a_run(toy, bus, put):
    heard = []
    toy.subscribe(keys.TARGET_CMD_VEL, lambda twist, _: heard.append(twist), advances_clock=False)
    put(keys.CLOCK, Clock(), at(0))
    toy.events.clear()
    put(keys.TARGET_CMD_VEL, forward(0.1), at(3, run=2))
    assert (heard, toy.events, toy.stamp) == ([], [], at(0))
    put(keys.TARGET_CMD_VEL, forward(0.2), at(3))
    bus.put_bytes("target/cmd_vel", b'{"linear":{"x":0.3}}')
    bus.spin()
    assert heard == [forward(0.2), forward(0.3)]


def test_each_tick_is_answered_once_and_in_order(toy, put):
    for tick in (0, 1, 1, 0, 2, 5, 4, 5):
        put(keys.JOINT_STATES, JointState(), at(tick))
    assert toy.events == [("reset", 9), *(("joints", tick) for tick in (0, 1, 2, 5))]


def test_each_tick_is_answered_again_in_a_new_run(toy, put):
    for run in (1, 2):
        put(keys.JOINT_STATES, JointState(), at(3, run=run))
        put(keys.JOINT_STATES, JointState(), at(3, run=run))
    assert toy.events == [("reset", 9), ("joints", 3), ("reset", 9), ("joints", 3)]


def test_a_tick_without_a_stamp_is_not_answered(toy, bus):
    bus.put_bytes("joint_states", b"{}")
    bus.spin()
    assert toy.events == []


def test_the_newest_tick_is_known_whatever_comes_late(toy, put):
    put(keys.CLOCK, Clock(), at(5))
    put(keys.CMD_VEL, forward(0.1), at(4))
    assert toy.stamp == at(5)
    assert toy.events[-1] == ("cmd_vel", 0.1, at(4))


def test_who_owns_time_hears_only_its_own_run_and_is_reset_by_none(bus, scenario, put):
    keeper = Timekeeper(bus, scenario)
    keeper.stamp = at(3, run=2)
    put(keys.CMD_VEL, forward(0.1), at(4, run=1))
    put(keys.CMD_VEL, forward(0.2), at(4, run=3))
    put(keys.JOINT_STATES, JointState(), at(4, run=3))
    assert keeper.events == [("reset", 5)]
    put(keys.CMD_VEL, forward(0.3), at(4, run=2))
    put(keys.JOINT_STATES, JointState(), at(4, run=2))
    assert keeper.events[1:] == [("cmd_vel", 0.3, at(4, run=2)), ("joints", 4)]
    assert keeper.stamp == at(3, run=2)


@pytest.fixture
def reports(bus):
    reports = []
    bus.subscribe(keys.diagnostics("toy"), lambda array, stamp: reports.append((array, stamp)))
    return reports


@pytest.mark.usefixtures("toy")
def test_its_health_is_told_once_each_simulated_second(put, reports):
    for tick in range(301):
        put(keys.CLOCK, Clock(Time.from_ns(tick * TICK_NS)), at(tick))
    assert [stamp.time_ns for _, stamp in reports] == [0, 10**9, 2 * 10**9, 3 * 10**9]
    assert [array.header.stamp.sec for array, _ in reports] == [0, 1, 2, 3]


@pytest.mark.usefixtures("toy")
def test_when_all_is_well_expect_level_ok(put, reports):
    put(keys.CLOCK, Clock(), at(0))
    array, _ = reports[0]
    assert isinstance(array, DiagnosticArray)
    (status,) = array.status
    assert (status.level, status.name, status.message) == (0, "toy", "ok")
    assert status.values == (
        KeyValue("events", "1"),
        KeyValue("missed_ticks", "0"),
        KeyValue("refused_payloads", "0"),
    )


def values(report):
    return {pair.key: pair.value for pair in report[0].status[0].values}


@pytest.mark.usefixtures("toy")
def test_the_rate_of_each_input_is_told_in_simulated_time(put, reports):
    for tick in range(0, 301):
        put(keys.CLOCK, Clock(), at(tick))
        if 100 <= tick < 200 and tick % 4 == 0:
            put(keys.CMD_VEL, forward(0.1), at(tick))
    assert [values(report).get("hz/clock") for report in reports] == [
        None,
        "100.0",
        "100.0",
        "100.0",
    ]
    assert [values(report).get("hz/cmd_vel") for report in reports] == [None, "0.0", "25.0", "0.0"]


@pytest.mark.usefixtures("toy")
def test_the_age_of_each_input_is_counted_from_the_newest_tick(bus, put, reports):
    for tick in range(301):
        put(keys.CLOCK, Clock(), at(tick))
        if tick == 120:
            put(keys.CMD_VEL, forward(0.1), at(tick))
        if tick == 250:
            bus.put_bytes("cmd_vel", b"{}")
    ages = [values(report).get("age_s/cmd_vel") for report in reports]
    assert ages == [None, "never", "0.8", "0.5"]
    assert values(reports[-1])["age_s/joint_states"] == "never"


@pytest.mark.usefixtures("toy")
def test_a_new_run_begins_with_inputs_that_never_came(put, reports):
    for run in (1, 2):
        for tick in range(101):
            put(keys.CLOCK, Clock(), at(tick, run=run))
            if run == 1:
                put(keys.CMD_VEL, forward(0.1), at(tick, run=run))
    assert [values(report).get("age_s/cmd_vel") for report in reports] == [
        None,
        "0.01",
        None,
        "never",
    ]
    assert [values(report).get("hz/cmd_vel") for report in reports] == [None, "100.0", None, "0.0"]


@pytest.mark.parametrize(
    ("ticks", "missed"),
    [((0, 1, 2, 3, 4), 0), ((0, 1, 3, 4, 7), 3), ((0, 2, 4, 6), 0), ((5, 7, 9, 15), 2), ((), 0)],
)
def test_ticks_that_were_never_heard_of_are_counted(toy, put, ticks, missed):
    for tick in ticks:
        put(keys.JOINT_STATES, JointState(), at(tick))
    assert toy.missed_ticks == missed


def test_between_two_runs_no_tick_is_missed(toy, put):
    for run, tick in ((1, 0), (1, 1), (2, 0), (2, 1), (3, 70), (3, 71)):
        put(keys.JOINT_STATES, JointState(), at(tick, run=run))
    assert toy.missed_ticks == 0


@pytest.mark.usefixtures("toy")
def test_who_has_gone_and_come_back_is_counted_and_told(bus, put, reports):
    back = []
    bus.presence.on_return.append(back.append)
    for alive in (True, False, True, True, False, True):
        bus.presence.update("controller", alive=alive)
    bus.presence.update("tool", alive=True)
    bus.presence.update("tool", alive=False)
    bus.presence.update("tool", alive=True)
    put(keys.CLOCK, Clock(), at(0))
    assert back == ["controller", "controller", "tool"]
    said = {key: value for key, value in values(reports[0]).items() if "restarts" in key}
    assert said == {"restarts/controller": "2"}


@pytest.mark.usefixtures("toy")
def test_payloads_that_were_refused_are_counted_by_key(bus, put, reports):
    for key in ("cmd_vel", "cmd_vel", "joint_states"):
        bus.put_bytes(key, b"x")
    put(keys.CLOCK, Clock(), at(0))
    said = {key: value for key, value in values(reports[0]).items() if "refused/" in key}
    assert said == {"refused/cmd_vel": "2", "refused/joint_states": "1"}


@pytest.mark.usefixtures("toy")
def test_when_payloads_were_refused_expect_a_warning_with_their_number(bus, put, reports):
    for payload in (b"", b"x", b"[]"):
        bus.put_bytes("cmd_vel", payload)
    put(keys.CLOCK, Clock(), at(0))
    (status,) = reports[0][0].status
    assert (status.level, status.message) == (1, "refused payloads")
    assert KeyValue("refused_payloads", "3") in status.values
