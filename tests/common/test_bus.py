"""The contract of a bus, for the local one and the one over Zenoh."""

from types import SimpleNamespace

import pytest
from harness import error_of, forward
from mecazen import keys
from mecazen import messages as m
from mecazen.errors import BusError
from mecazen.wire import JSON_ENCODING, MAX_SAMPLE_BYTES, Stamp

STAMP = Stamp(10_000_000, 3, 7)


@pytest.fixture
def received(pair):
    """Samples that arrive on cmd_vel, from a linked far bus."""
    samples = []
    pair.near.subscribe(keys.CMD_VEL, lambda message, stamp: samples.append((message, stamp)))
    pair.link()
    return samples


def test_messages_and_bytes_arrive_with_or_without_a_stamp(pair, received):
    for encoding, stamp in (("", None), (JSON_ENCODING, STAMP)):
        pair.far.publisher(keys.CMD_VEL).put(forward(0.2), stamp)
        pair.settle()
        pair.far.put_bytes("cmd_vel", b'{"linear":{"x":0.5}}\n', encoding, stamp and stamp.pack())
        pair.settle()
    assert received == [(forward(x), stamp) for stamp in (None, STAMP) for x in (0.2, 0.5)]


def test_with_every_all_samples_arrive_in_order_across_keys(pair):
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


def test_a_refused_sample_is_counted_and_the_last_value_stays(pair, received, caplog):
    wrong = [
        (b"", None),
        (b"{", None),
        (b'{"linear":{"x":1e9}}', None),
        (b"{}" + b" " * MAX_SAMPLE_BYTES, None),
        (b"{}", b"no stamp"),
    ]
    pair.far.put_bytes("cmd_vel", b'{"linear":{"x":0.2}}')
    pair.settle()
    for count, (payload, attachment) in enumerate(wrong, 1):
        pair.far.put_bytes("cmd_vel", payload, "", attachment)
        pair.settle()
        assert pair.near.refused == {"cmd_vel": count}
    assert received == [(forward(0.2), None)]
    assert caplog.messages[0] == "msg=refused key=cmd_vel count=1 reason='empty payload'"
    pair.far.put_bytes("cmd_vel", b'{"linear":{"x":0.3}}')
    pair.settle()
    assert received[1:] == [(forward(0.3), None)]


def test_a_key_is_logged_once_a_second_and_every_refusal_counted(bus, caplog, monkeypatch):
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr("mecazen.bus.base.time", SimpleNamespace(monotonic=lambda: now.s))
    speeds = []
    bus.subscribe(keys.CMD_VEL, lambda twist, _: speeds.append(twist.linear.x))
    for step_s in (1.0, 0.99, 0.02):
        now.s += step_s
        for _ in range(50):
            bus.put_bytes("cmd_vel", b"nonsense")
    assert bus.refused == {"cmd_vel": 150}
    assert not speeds
    _, line = caplog.messages
    assert line.startswith("msg=refused key=cmd_vel count=101 reason=")


def test_files_are_fetched_by_key_and_by_expression(pair):
    files = {"meshes/wheel.stl": b"\x00wheel", "meshes/roller.stl": b"roller", "robot.urdf": b""}
    pair.near.serve_files("robot_description", files)
    selected = {
        "meshes/wheel.stl": ["meshes/wheel.stl"],
        "meshes/*": ["meshes/wheel.stl", "meshes/roller.stl"],
        "**": list(files),
        "meshes/none.stl": [],
    }
    pair.link()
    with pair.serving():
        for selector, paths in selected.items():
            expected = {f"robot_description/{path}": files[path] for path in paths}
            assert pair.far.fetch_files(f"robot_description/{selector}") == expected
    assert len(pair.near.fetch_files("robot_description/**")) == len(files)


def test_a_query_is_answered_refused_or_not_answered(pair):
    near, far = pair.near, pair.far
    near.serve(keys.SIM_STEP, lambda request, reply: reply.answer(m.SimState(tick=request.ticks)))
    near.serve(keys.SIM_RESET, lambda _, reply: reply.refuse("pause first"))
    assert near.call(keys.SIM_STEP, m.StepRequest(ticks=5)).tick == 5
    pair.link()
    with pair.serving():
        assert far.call(keys.SIM_STEP, m.StepRequest(ticks=5)).tick == 5
        text = error_of(BusError, lambda: far.call(keys.SIM_RESET, m.ResetRequest()))
        assert text == "sim/reset: pause first"
    text = error_of(BusError, lambda: far.call(keys.SET_ODOMETRY, m.OdometryRequest()))
    assert text.startswith("set_odometry: nobody answers")

    near.serve(keys.SIM_PAUSE, lambda *_: None)
    line = r"^sim/pause: not answered$" if pair.is_local else r"^sim/pause: "
    with pair.serving(), pytest.raises(BusError, match=line):
        far.call(keys.SIM_PAUSE, m.Empty(), timeout_s=0.05)


def test_an_error_of_a_handler_reaches_the_caller(zenoh_pair):
    zenoh_pair.near.subscribe(keys.CMD_VEL, lambda *_: 1 / 0)
    zenoh_pair.link()
    zenoh_pair.far.publisher(keys.CMD_VEL).put(forward(0.2), STAMP)
    with pytest.raises(ZeroDivisionError):
        zenoh_pair.settle()
