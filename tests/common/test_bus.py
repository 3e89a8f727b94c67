"""The contract of a bus, for the local one and the one over Zenoh; and what only sessions have."""

import secrets
import signal
import threading
from types import SimpleNamespace

import pytest
import zenoh
from harness import error_of, forward, wait
from mecazen import keys
from mecazen import messages as m
from mecazen.bus import StoppedError
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import SAMPLE_BYTES
from mecazen.config import BusConfig
from mecazen.errors import BusError
from mecazen.keys import Call
from mecazen.wire import JSON_ENCODING, MAX_SAMPLE_BYTES, Stamp, decode

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
        "*/**": list(files),
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


@pytest.fixture
def flood(zenoh_pair):
    """Run a function that puts samples on the pair's near bus; all wait then at its far one."""
    zenoh_pair.far.declare_alive("asker")
    wait(zenoh_pair.near, lambda: "asker" in zenoh_pair.near.presence.names)

    def run(put):
        # the answer comes after the samples on the same link: all have arrived when it is there
        call = Call(f"test/{secrets.token_hex(3)}", m.Empty, m.SimState, "a test", "")
        zenoh_pair.near.serve(call, lambda _, reply: (put(), reply.answer(m.SimState())))
        zenoh_pair.link()
        with zenoh_pair.serving():
            zenoh_pair.far.call(call, m.Empty())

    return run


def test_a_newer_sample_replaces_one_that_waits_and_with_every_it_does_not(zenoh_pair, flood):
    near, far = zenoh_pair.far, zenoh_pair.near
    latest, every = [], []
    near.subscribe(keys.CLOCK, lambda clock, _: latest.append(clock.clock.sec))
    near.subscribe(keys.CLOCK, lambda clock, _: every.append(clock.clock.sec), every=True)
    clocks = far.publisher(keys.CLOCK)
    flood(lambda: [clocks.put(m.Clock(m.Time(tick)), STAMP) for tick in range(1, 101)])
    near.drain()
    assert latest == [100]
    assert near.lost == {"clock": 99}
    assert every == list(range(1, 101))


def test_malformed_samples_do_not_replace_a_good_one(zenoh_pair, flood):
    near, far = zenoh_pair.far, zenoh_pair.near
    speeds = []
    near.subscribe(keys.CMD_VEL, lambda twist, _: speeds.append(twist.linear.x))

    def put():
        far.put_bytes("cmd_vel", b'{"linear":{"x":2.0}}')
        for wrong in (b"{", b"", b'{"linear":3}', bytes(MAX_SAMPLE_BYTES + 1)) * 5:
            far.put_bytes("cmd_vel", wrong)

    flood(put)
    near.drain()
    assert speeds == [2.0]
    assert near.refused == {"cmd_vel": 20}
    assert not near.lost


def test_a_full_picture_fits_and_a_longer_one_is_not_sent(zenoh_pair, caplog):
    near, far = zenoh_pair.far, zenoh_pair.near
    sizes, nothing = [], []
    near.subscribe(
        keys.DEPTH, lambda picture, _: sizes.append(len(picture.data)), nothing=nothing.append
    )
    zenoh_pair.link()
    pixels = bytes(1920 * 1080 * 2)  # 16 bits a pixel, the largest picture of the configuration
    far.publisher(keys.DEPTH).put(m.Image(data=pixels), STAMP)
    wait(near, lambda: sizes == [len(pixels)])
    far.publisher(keys.DEPTH).put(m.Image(data=2 * pixels), STAMP)
    wait(near, lambda: nothing == [STAMP])
    assert (far.refused, near.refused) == ({"camera/depth": 1}, {})
    assert "not sent: 11059327 bytes, at most 6291456" in caplog.text


def test_a_put_on_an_expression_that_includes_a_key_is_refused(zenoh_pair):
    # clients that may put `*` or `**/cmd_vel` would otherwise be heard on keys of others
    zenoh_pair.near.subscribe(keys.TARGET_CMD_VEL, lambda *_: pytest.fail("delivered"))
    zenoh_pair.link()
    for expression in ("**/cmd_vel", "target/*"):
        zenoh_pair.far.put_bytes(expression, b"{}")
    zenoh_pair.settle()
    assert zenoh_pair.near.refused == {"target/cmd_vel": 2}


def test_a_service_is_heard_by_its_session(open_bus):
    ear, frames = open_bus(), []
    ear.subscribe(
        keys.ODOM,
        lambda odom, _: frames.append(odom.child_frame_id),
        sender="controller",
        every=True,
    )
    ear.declare_alive("ear")

    def publish(bus, frame):
        bus.declare_alive(f"node {frame}")
        wait(bus, lambda: "ear" in bus.presence.names)
        count = len(frames) + ear.refused["odom"]
        bus.publisher(keys.ODOM).put(m.Odometry(child_frame_id=frame), STAMP)
        wait(ear, lambda: len(frames) + ear.refused["odom"] > count)

    publish(open_bus(), "early")
    intruder = open_bus()
    for frame in ("first", "restarted"):
        service = open_bus()
        service.declare_alive("controller")
        wait(ear, lambda: "controller" in ear.presence.names)
        publish(service, frame)
        publish(intruder, "intruder")
        service.close()
        wait(ear, lambda: "controller" not in ear.presence.names)
    assert frames == ["early", "first", "restarted"]
    assert ear.refused == {"odom": 2}


def test_bytes_of_this_process_and_others_arrive_and_keys_of_ros_do_not(zenoh_pair):
    near, far, samples = zenoh_pair.near, zenoh_pair.far, []
    near.subscribe_bytes("**/cmd_vel/**", lambda *sample: samples.append(sample))
    zenoh_pair.link()
    near.publisher(keys.CMD_VEL).put(m.Twist(), STAMP)
    wait(near, lambda: samples)
    far.put_bytes("0/cmd_vel/geometry_msgs::msg::dds_::Twist_/RIHS01_0", b"")
    far.put_bytes("two/cmd_vel", b"\xff", "image/png", b"any")
    wait(near, lambda: len(samples) == 2)
    (key, payload, *envelope), second = samples
    assert (key, payload[:1], envelope) == ("cmd_vel", b"{", [JSON_ENCODING, STAMP.pack()])
    assert second == ("two/cmd_vel", b"\xff", "image/png", b"any")


def test_bytes_beyond_the_backlog_are_refused_until_there_is_room(zenoh_pair, flood):
    near, far, kept = zenoh_pair.far, zenoh_pair.near, []
    size = SAMPLE_BYTES + len("of/ones/own") + len("text/plain") + 16 + 600
    near.subscribe_bytes("of/ones/own", lambda *sample: kept.append(sample), 4.5 * size)
    for total in (100, 200):
        flood(
            lambda: [
                far.put_bytes("of/ones/own", bytes(600), "text/plain", bytes(16))
                for _ in range(100)
            ]
        )
        near.drain()
        assert len(kept) == 4 * total / 100
        assert near.refused["of/ones/own"] == total - len(kept)


def test_a_robots_keys_are_in_its_namespace_alone(open_bus):
    name = f"test{secrets.token_hex(6)}"
    root, two, stranger = (open_bus(namespace=n) for n in (name, f"{name}/two", f"{name}x"))
    speeds, names = [], []
    root.subscribe(keys.of_robot(keys.CMD_VEL, "two"), lambda t, _: speeds.append(t.linear.x))
    root.subscribe(keys.CMD_VEL, lambda *_: speeds.append("in no robot's namespace"))
    stranger.subscribe_bytes("**", lambda key, *_: names.append(key))
    two.subscribe_bytes("odom", lambda key, *_: names.append(key))
    root.declare_alive("physics", "two")
    two.declare_alive("controller")
    wait(two, lambda: "physics" in two.presence.names)
    wait(root, lambda: root.presence.names == {"two/physics", "two/controller"})
    two.put_bytes("cmd_vel", b'{"linear":{"x":0.2}}')
    two.put_bytes("cmd_vel", b"{")
    root.put_bytes("two/odom", b"{}")
    wait(root, lambda: (speeds, root.refused) == ([0.2], {"two/cmd_vel": 1}))
    wait(two, lambda: bool(names))
    stranger.drain()
    assert names == ["odom"]


@pytest.fixture
def ask(open_bus, router):
    """Return a bus, and a function that returns all replies to a client without our code."""
    bus = open_bus(namespace="strange")
    with open_session(BusConfig(connect=(router,), namespace="strange"), "client") as session:

        def run(expression, payload=b""):
            handler, replies = zenoh.handlers.FifoChannel(16), []
            channel = session.get(expression, payload=payload, handler=handler)
            while True:
                bus.drain()
                try:
                    reply = channel.try_recv()
                except zenoh.ZError:  # no more will come
                    return replies
                if reply is not None:
                    replies.append(reply)

        bus.serve(keys.SIM_STATE, lambda _, reply: reply.answer(m.SimState(tick=7)))
        while not run("sim/state"):  # the session has not yet discovered the server
            pass
        yield bus, run


def test_a_query_on_an_expression_reads_and_changes_nothing(ask):
    (bus, run), resets = ask, []
    bus.serve(keys.SIM_RESET, lambda _, reply: (resets.append(1), reply.answer(m.SimState())))
    bus.serve_files("robot_description", {"a.stl": b"mesh"})
    while not run("robot_description/a.stl"):  # discovered after what was declared before it
        pass
    for count, (expression, answers) in enumerate(
        (("**", {"sim/state", "robot_description/a.stl"}), ("*/reset", set())), 1
    ):
        replies = run(expression)
        assert {str(reply.ok.key_expr) for reply in replies if reply.ok} == answers
        errors = [reply.err.payload.to_string() for reply in replies if reply.err]
        assert errors == ["asked on another key expression"]
        assert (resets, bus.refused) == ([], {"sim/reset": count})
    assert run("sim/reset")[0].ok is not None
    assert resets == [1]


def test_wrong_requests_are_errors_and_empty_ones_defaults(ask):
    bus, run = ask
    bus.serve(keys.SIM_STEP, lambda request, reply: reply.answer(m.SimState(tick=request.ticks)))
    while not run("sim/step"):
        pass
    for payload in (b"", b" \n", b"{}"):
        (reply,) = run("sim/step", payload)
        assert decode(reply.ok.payload.to_bytes(), m.SimState).tick == 1
    for count, payload in enumerate((b'{"ticks":0}', b'{"ticks":"x"}', b"x", b"[]", b"\xc0"), 1):
        (reply,) = run("sim/step", payload)
        assert reply.err.payload.to_string().startswith("not a mecazen_msgs/msg/StepRequest: ")
        assert bus.refused == {"sim/step": count}


def test_a_signal_that_another_thread_receives_ends_a_wait(open_bus):
    bus, gate = open_bus(), threading.Semaphore(0)

    def interrupt():
        gate.acquire()
        signal.pthread_kill(threading.get_ident(), signal.SIGUSR1)

    before = signal.signal(signal.SIGUSR1, lambda *_: bus.stop())
    thread = threading.Thread(target=interrupt)
    thread.start()
    try:
        gate.release()
        with pytest.raises(StoppedError):
            bus.spin_once()
    finally:
        signal.signal(signal.SIGUSR1, before)
        thread.join()
