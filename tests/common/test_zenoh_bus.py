"""The bus over Zenoh: real sessions on loopback, each test in a namespace of its own."""

import secrets
import signal
import threading

import pytest
import zenoh
from harness import error_of, wait
from mecazen import keys
from mecazen.bus import StoppedError
from mecazen.bus.session import open_session
from mecazen.bus.zenoh_bus import SAMPLE_BYTES
from mecazen.config import BusConfig
from mecazen.errors import BusError
from mecazen.keys import Call
from mecazen.messages import Clock, Empty, Image, Odometry, SimState, Time, Twist
from mecazen.wire import JSON_ENCODING, MAX_SAMPLE_BYTES, Stamp, decode

STAMP = Stamp(0, 1, 0)


@pytest.fixture
def flood(zenoh_pair):
    """Run a function that puts samples on the pair's near bus; all wait then at its far one."""
    zenoh_pair.far.declare_alive("asker")
    wait(zenoh_pair.near, lambda: "asker" in zenoh_pair.near.presence.names)

    def run(put):
        # the answer comes after the samples on the same link: all have arrived when it is there
        call = Call(f"test/{secrets.token_hex(3)}", Empty, SimState, "a test", "")
        zenoh_pair.near.serve(call, lambda _, reply: (put(), reply.answer(SimState())))
        zenoh_pair.link()
        with zenoh_pair.serving():
            zenoh_pair.far.call(call, Empty())

    return run


def test_a_newer_sample_replaces_one_that_waits_and_with_every_it_does_not(zenoh_pair, flood):
    near, far = zenoh_pair.far, zenoh_pair.near
    latest, every = [], []
    near.subscribe(keys.CLOCK, lambda clock, _: latest.append(clock.clock.sec))
    near.subscribe(keys.CLOCK, lambda clock, _: every.append(clock.clock.sec), every=True)
    clocks = far.publisher(keys.CLOCK)
    flood(lambda: [clocks.put(Clock(Time(tick)), STAMP) for tick in range(1, 101)])
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
    far.publisher(keys.DEPTH).put(Image(data=pixels), STAMP)
    wait(near, lambda: sizes == [len(pixels)])
    far.publisher(keys.DEPTH).put(Image(data=2 * pixels), STAMP)
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
        bus.publisher(keys.ODOM).put(Odometry(child_frame_id=frame), STAMP)
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
    near.publisher(keys.CMD_VEL).put(Twist(), STAMP)
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

        bus.serve(keys.SIM_STATE, lambda _, reply: reply.answer(SimState(tick=7)))
        while not run("sim/state"):  # the session has not yet discovered the server
            pass
        yield bus, run


def test_a_query_on_an_expression_reads_and_changes_nothing(ask):
    (bus, run), resets = ask, []
    bus.serve(keys.SIM_RESET, lambda _, reply: (resets.append(1), reply.answer(SimState())))
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
    bus.serve(keys.SIM_STEP, lambda request, reply: reply.answer(SimState(tick=request.ticks)))
    while not run("sim/step"):
        pass
    for payload in (b"", b" \n", b"{}"):
        (reply,) = run("sim/step", payload)
        assert decode(reply.ok.payload.to_bytes(), SimState).tick == 1
    for count, payload in enumerate((b'{"ticks":0}', b'{"ticks":"x"}', b"x", b"[]", b"\xc0"), 1):
        (reply,) = run("sim/step", payload)
        assert reply.err.payload.to_string().startswith("not a mecazen_msgs/msg/StepRequest: ")
        assert bus.refused == {"sim/step": count}


class BadAnswer(Empty):
    tick: str = "many"


def test_a_malformed_answer_is_one_line(zenoh_pair):
    near, far = zenoh_pair.near, zenoh_pair.far
    bad = Call("sim/reset", Empty, BadAnswer, "a test", "")
    near.serve(bad, lambda _, reply: reply.answer(BadAnswer()))
    zenoh_pair.link()
    with zenoh_pair.serving():
        text = error_of(BusError, lambda: far.call(keys.SIM_RESET, keys.SIM_RESET.request()))
        assert text.startswith("sim/reset: the answer is not a mecazen_msgs/msg/SimState: ")


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
