"""Behaviour that both buses share; `test_local` and `test_zenoh_bus` test that of one."""

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest
from harness import error_of, forward, wait
from mecazen import keys
from mecazen import messages as m
from mecazen.bus import base
from mecazen.errors import BusError
from mecazen.wire import (
    JSON_ENCODING,
    MAX_PAYLOAD_BYTES,
    Stamp,
)

STAMP = Stamp(10_000_000, 3, 7)


@pytest.fixture
def clock(monkeypatch):
    """The clock that limits the log; it stands until a test moves it."""
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr("mecazen.bus.base.time", SimpleNamespace(monotonic=lambda: now.s))
    return now


@pytest.fixture
def received(pair):
    """Samples that arrive on cmd_vel, from a linked far bus."""
    samples = []
    pair.near.subscribe(keys.CMD_VEL, lambda message, stamp: samples.append((message, stamp)))
    pair.link()
    return samples


def test_a_sample_arrives_with_its_stamp(pair, received):
    pair.far.publisher(keys.CMD_VEL).put(forward(0.2), STAMP)
    pair.settle()
    assert received == [(forward(0.2), STAMP)]


def test_with_every_all_samples_arrive_in_order_also_across_keys(pair):
    samples = []
    for topic in (keys.CMD_VEL, keys.CLOCK):
        pair.near.subscribe(topic, lambda message, _: samples.append(message), every=True)
    pair.link()
    clocks, commands = pair.far.publisher(keys.CLOCK), pair.far.publisher(keys.CMD_VEL)
    expected = []
    for tick in range(100):
        clocks.put(m.Clock(m.Time(tick)), STAMP)
        commands.put(forward(tick), STAMP)
        expected += [m.Clock(m.Time(tick)), forward(tick)]
    pair.settle()
    assert samples == expected


def test_what_the_process_serves_itself_is_answered_on_the_same_thread(pair):
    pair.near.serve(
        keys.SIM_STEP, lambda request, reply: reply.answer(m.SimState(tick=request.ticks))
    )
    pair.near.serve_files("robot_description", {"a.stl": b"mesh"})
    assert pair.near.call(keys.SIM_STEP, m.StepRequest(ticks=5)) == m.SimState(tick=5)
    files = {"robot_description/a.stl": b"mesh"}
    assert pair.near.fetch_files("robot_description/**") == files


JSON = b'{"linear":{"x":0.5}}\n'


@pytest.mark.parametrize("stamp", [None, STAMP])
@pytest.mark.parametrize("encoding", ["", JSON_ENCODING])
def test_an_outsiders_bytes_arrive_with_or_without_a_stamp(pair, received, encoding, stamp):
    pair.far.put_bytes("cmd_vel", JSON, encoding, stamp and stamp.pack())
    pair.settle()
    assert received == [(forward(0.5), stamp)]


@pytest.mark.parametrize(
    ("payload", "attachment"),
    [
        (b"", None),
        (b'{"linear":{"x":NaN}}', None),
        (b"{}" + b" " * MAX_PAYLOAD_BYTES, None),
        (b"{}", b"15 bytes, not 16"[:15]),
        (b"{}", b"\xff" * 16),
    ],
    ids=["empty", "nan", "oversize", "short", "negative"],
)
def test_what_is_refused_is_counted_and_the_last_good_value_stays(
    pair, received, caplog, payload, attachment
):
    pair.far.put_bytes("cmd_vel", b'{"linear":{"x":0.2}}')
    pair.settle()
    pair.far.put_bytes("cmd_vel", payload, "", attachment)
    pair.settle()
    assert received == [(forward(0.2), None)]
    assert pair.near.refused == {"cmd_vel": 1}
    (line,) = caplog.messages
    assert line.startswith("msg=refused key=cmd_vel count=1 reason=")
    assert len(line.splitlines()) == 1
    pair.far.put_bytes("cmd_vel", b'{"linear":{"x":0.3}}')
    pair.settle()
    assert received[1:] == [(forward(0.3), None)]


def test_refusals_are_logged_once_a_second_for_each_key_and_all_are_counted(pair, caplog, clock):
    for topic in (keys.CMD_VEL, keys.TARGET_CMD_VEL):
        pair.near.subscribe(topic, lambda *_: None, every=True)
    pair.link()

    def put(key, times):
        for _ in range(times):
            pair.far.put_bytes(key, b"nonsense")
        pair.settle()

    put("cmd_vel", 50)
    put("target/cmd_vel", 2)
    clock.s += 0.99
    put("cmd_vel", 50)
    assert [line.partition(" reason")[0] for line in caplog.messages] == [
        "msg=refused key=cmd_vel count=1",
        "msg=refused key=target/cmd_vel count=1",
    ]
    clock.s += 0.02
    put("cmd_vel", 50)
    assert [line.partition(" reason")[0] for line in caplog.messages[2:]] == [
        "msg=refused key=cmd_vel count=101"
    ]
    assert pair.near.refused == {"cmd_vel": 150, "target/cmd_vel": 2}


@pytest.mark.parametrize(
    ("payload", "told"),
    [
        (
            b'{"linaer":{"x":1},"linear":{"x":0.25}}',
            "linaer is ignored; did you mean linear? allowed: linear, angular",
        ),
        (b'{"linear":{"X":1,"x":0.25}}', "linear.X is ignored; allowed: x, y, z"),
        (
            b'{"\\u001b[2J":1,"linear":{"x":0.25}}',
            "\\u001b[2J is ignored; allowed: linear, angular",
        ),
        (
            b'{"' + b"x" * 1000 + b'":1,"linear":{"x":0.25}}',
            f"{'x' * 60}… is ignored; allowed: linear, angular",
        ),
    ],
    ids=["typo", "nested", "escape", "long"],
)
def test_an_outsiders_unknown_field_is_told_of_and_the_rest_is_obeyed(
    pair, received, caplog, clock, payload, told
):
    for _ in range(3):
        pair.far.put_bytes("cmd_vel", payload)
        pair.settle()
    assert set(received) == {(forward(0.25), None)}
    assert pair.near.ignored == {"cmd_vel": told}
    assert caplog.messages == [f"msg=ignored key=cmd_vel reason={told!r}"]
    assert not pair.near.refused


def test_only_what_people_write_is_looked_at_for_unknown_fields(pair, received):
    pair.far.put_bytes("cmd_vel", b'{"mine":1,"linear":{}}', "", STAMP.pack())  # of a node
    pair.settle()
    assert received == [(m.Twist(), STAMP)]
    assert not pair.near.ignored


def test_whatever_an_unknown_field_holds_the_next_sample_arrives(pair, received):
    for held in (b"1e999", b"[" * 900 + b"]" * 900, b'"\xff"', b'"\\ud800"'):
        pair.far.put_bytes("cmd_vel", b'{"mine":' + held + b"}")
        pair.settle()
    pair.far.put_bytes("cmd_vel", b'{"linear":{"x":0.25}}')
    pair.settle()
    assert received[-1] == (forward(0.25), None)


def test_files_are_fetched_by_key_and_by_expression(pair):
    files = {"meshes/wheel.stl": b"\x00wheel", "meshes/roller.stl": b"roller", "robot.urdf": b""}
    pair.near.serve_files("robot_description", files)
    stl = ["meshes/wheel.stl", "meshes/roller.stl"]
    by_asked = {stl[0]: stl[:1], "meshes/*": stl, "**": list(files), "meshes/none.stl": []}
    pair.link()
    with pair.serving():
        for asked, paths in by_asked.items():
            expected = {f"robot_description/{path}": files[path] for path in paths}
            assert pair.far.fetch_files(f"robot_description/{asked}") == expected


def test_a_query_may_be_answered_later(pair):
    replies = []
    pair.near.serve(keys.SIM_RESET, lambda _, reply: replies.append(reply))
    pair.near.serve(keys.SIM_PAUSE, lambda _, reply: reply.answer(m.SimState(tick=1)))
    if pair.is_local:
        pytest.skip("within one process nothing happens while a caller waits")
    pair.link()
    with pair.serving(), ThreadPoolExecutor() as pool:
        later = pool.submit(pair.far.call, keys.SIM_RESET, keys.SIM_RESET.request())
        while not replies:
            assert pair.far.call(keys.SIM_PAUSE, m.Empty()).tick == 1
        replies.pop().answer(m.SimState(tick=2))
        assert later.result().tick == 2


def test_when_a_query_is_refused_expect_the_reason(pair):
    pair.near.serve(keys.SIM_STEP, lambda _, reply: reply.refuse("pause first"))
    pair.link()
    with pair.serving(), pytest.raises(BusError, match=r"^sim/step: pause first$"):
        pair.far.call(keys.SIM_STEP, m.StepRequest())


def test_when_nobody_answers_expect_that_said(pair):
    pair.link()
    text = error_of(BusError, lambda: pair.far.call(keys.SET_ODOMETRY, m.OdometryRequest()))
    assert text.startswith("set_odometry: nobody answers")


def test_who_is_alive_is_present_and_told_of(pair):
    told = []
    pair.near.presence.on_change.append(lambda: told.append(set(pair.near.presence.names)))
    pair.far.declare_alive("physics")
    pair.far.declare_alive("physics/ready")
    wait(pair.near, lambda: {"physics", "physics/ready"} <= pair.near.presence.names)
    assert told[-1] >= {"physics", "physics/ready"}


def test_spin_once_when_nothing_came_in_time_is_false(pair):
    pair.link()
    pair.settle()
    while pair.near.spin_once(0.0):
        pass
    assert pair.near.spin_once(0.001) is False


def test_what_a_handler_raises_reaches_who_spins(pair):
    def fail(message, stamp):
        raise ZeroDivisionError

    pair.near.subscribe(keys.CMD_VEL, fail)
    pair.link()

    def put():
        pair.far.publisher(keys.CMD_VEL).put(forward(0.2), STAMP)
        pair.settle()  # within a process the put has reached it at once

    with pytest.raises(ZeroDivisionError):
        put()


def test_refused_keys_are_counted_by_name_up_to_a_number(open_bus):
    bus = open_bus()
    for number in range(base.REFUSED_KEYS + 5):
        bus.refuse(f"diagnostics/{number}", "for a test")
    assert len(bus.refused) == base.REFUSED_KEYS + 1
    assert bus.refused[base.OTHER_KEYS] == 5
