"""The bus over Zenoh: real sessions on loopback, each test in a namespace of its own."""

import secrets
import signal
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import pytest
import zenoh
from harness import error_of, wait
from mecazen import keys
from mecazen.bus import StoppedError, base
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.errors import BusError
from mecazen.keys import Call
from mecazen.messages import Clock, Empty, Image, SimState, Time, Twist, Vector3
from mecazen.wire import (
    JSON_ENCODING,
    MAX_ENVELOPE_BYTES,
    MAX_SAMPLE_BYTES,
    Stamp,
)

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


def test_a_sample_that_was_not_taken_is_replaced_and_counted_and_with_every_is_kept(
    zenoh_pair, flood
):
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


def test_a_sample_is_decoded_once_for_all_subscribers_of_its_key(zenoh_pair, monkeypatch):
    decoded, heard = [], []

    def decode_sample(topic, *sample):
        decoded.append(topic.key)
        return base.decode_sample(topic, *sample)

    monkeypatch.setattr("mecazen.bus.zenoh_bus.decode_sample", decode_sample)
    for _ in range(3):
        zenoh_pair.near.subscribe(keys.CLOCK, lambda clock, _: heard.append(clock))
    zenoh_pair.link()
    zenoh_pair.far.publisher(keys.CLOCK).put(Clock(Time(1)), STAMP)
    zenoh_pair.settle()
    assert decoded == ["clock", "test/end"]
    assert len(heard) == 3


def test_a_subscription_of_bytes_hears_what_the_own_process_puts(open_bus):
    bus, heard = open_bus(), []
    bus.subscribe(keys.CMD_VEL, lambda *_: None)
    bus.subscribe_bytes("*", lambda key, *_: heard.append(key))
    bus.publisher(keys.CMD_VEL).put(Twist(), STAMP)
    bus.put_bytes("cmd_vel", b"{}")
    bus.drain()
    assert heard == ["cmd_vel", "cmd_vel"]


def test_samples_that_gather_come_all_and_in_order(router, open_bus, pair_of):
    far, numbers = open_bus(namespace="gathered"), list(range(1000))
    config = BusConfig(connect=(router,), namespace="gathered")
    with closing(ZenohBus(config, gather_s=0.02)) as near:
        heard = []
        near.subscribe(keys.CLOCK, lambda clock, _: heard.append(clock.clock.sec), every=True)
        pair_of(near, far).link()
        clocks = far.publisher(keys.CLOCK)
        for number in numbers:
            clocks.put(Clock(Time(number)), STAMP)
        wait(near, lambda: len(heard) == len(numbers))
    assert heard == numbers


def test_the_newest_good_sample_is_taken_although_malformed_ones_came_after_it(zenoh_pair, flood):
    near, far = zenoh_pair.far, zenoh_pair.near
    speeds = []
    near.subscribe(keys.CMD_VEL, lambda twist, _: speeds.append(twist.linear.x))

    def put():
        far.put_bytes("cmd_vel", b'{"linear":{"x":1.0}}')
        far.put_bytes("cmd_vel", b'{"linear":{"x":2.0}}')
        for wrong in (b"{", b"", b'{"linear":3}') * 20:
            far.put_bytes("cmd_vel", wrong)
        far.put_bytes("cmd_vel", bytes(MAX_SAMPLE_BYTES + 1))

    flood(put)
    near.drain()
    assert speeds == [2.0]
    assert near.refused == {"cmd_vel": 61}


def test_a_full_picture_fits_and_what_is_longer_is_refused_by_its_publisher(zenoh_pair):
    near, far = zenoh_pair.far, zenoh_pair.near
    heard, nothing = [], []
    near.subscribe(
        keys.DEPTH, lambda picture, _: heard.append(len(picture.data)), nothing=nothing.append
    )
    zenoh_pair.link()
    pixels = bytes(1920 * 1080 * 2)  # 16 bits a pixel, the largest picture of the configuration
    far.publisher(keys.DEPTH).put(Image(data=pixels), STAMP)
    wait(near, lambda: heard == [len(pixels)])
    far.publisher(keys.DEPTH).put(Image(data=2 * pixels), STAMP)
    wait(near, lambda: nothing == [STAMP])
    assert (far.refused, near.refused) == ({"camera/depth": 1}, {})


def test_what_is_put_on_an_expression_that_holds_a_key_is_refused(zenoh_pair):
    # who may put `*` or `**/cmd_vel` would otherwise be heard on keys that are not theirs
    zenoh_pair.near.subscribe(keys.TARGET_CMD_VEL, lambda *_: pytest.fail("delivered"))
    zenoh_pair.link()
    zenoh_pair.far.put_bytes("**/cmd_vel", b"{}")
    zenoh_pair.far.put_bytes("target/*", b"{}")
    zenoh_pair.settle()
    assert zenoh_pair.near.refused == {"target/cmd_vel": 2}


def test_what_comes_while_too_much_waits_is_refused_and_counted(zenoh_pair, flood):
    near, far = zenoh_pair.far, zenoh_pair.near
    kept = []
    near.subscribe_bytes("clock", lambda *sample: kept.append(sample), 5_000)
    for total in (100, 200):
        flood(lambda: [far.put_bytes("clock", bytes(600)) for _ in range(100)])
        near.drain()
        # four of 600 bytes and what each needs besides have place among 5,000
        assert len(kept) == 4 * total / 100
        assert near.refused["clock"] == total - len(kept)


@pytest.mark.parametrize("mode", ["peer", "client"])
def test_samples_are_json_with_its_encoding(open_bus, pair_of, mode):
    near, far = open_bus(mode), open_bus()
    samples = []
    near.subscribe_bytes("*", lambda *sample: samples.append(sample))
    pair_of(near, far).link()
    far.publisher(keys.CMD_VEL).put(Twist(linear=Vector3(x=0.2)), STAMP)
    wait(near, lambda: bool(samples))
    key, payload, encoding, attachment = samples[0]
    assert (key, encoding, attachment) == ("cmd_vel", JSON_ENCODING, STAMP.pack())
    assert payload.startswith(b"{")


def test_namespaces_do_not_hear_each_other(open_bus):
    names = [f"test{secrets.token_hex(6)}" for _ in range(2)]
    ears = [open_bus(namespace=name) for name in names]
    heard = [[], []]
    for ear, samples in zip(ears, heard, strict=True):
        ear.subscribe_bytes("**", lambda key, *_, to=samples: to.append(key))
        ear.declare_alive("ear")
    mouths = [open_bus(namespace=name) for name in names]
    for mouth in mouths:
        mouth.declare_alive("mouth")
        wait(mouth, lambda mouth=mouth: "ear" in mouth.presence.names)
    for _ in range(3):
        for number, mouth in enumerate(mouths):
            mouth.put_bytes(f"from/{number}", b"{}")
    for ear, samples in zip(ears, heard, strict=True):
        wait(ear, lambda samples=samples: len(samples) == 3)
    assert heard == [["from/0"] * 3, ["from/1"] * 3]


def test_who_closes_is_gone_for_all(open_bus):
    near, far = open_bus(), open_bus()
    near.declare_alive("near")
    far.declare_alive("physics")
    wait(near, lambda: "physics" in near.presence.names)
    asker = open_bus("client")
    wait(asker, lambda: asker.alive() == {"near", "physics"})
    far.close()
    wait(near, lambda: "physics" not in near.presence.names)
    wait(asker, lambda: asker.alive() == {"near"})


def test_a_session_that_can_not_close_is_reported_and_hides_no_other_error(open_bus, caplog):
    class Stuck:
        def close(self):
            raise zenoh.ZError("close operation timed out! at close.rs:135.")

    bus = open_bus()
    session, bus._session = bus._session, Stuck()
    bus.close()
    bus._session = session
    assert "the session did not close: close operation timed out!" in caplog.text


def test_stop_ends_a_waiting_spin_once_from_another_thread(open_bus):
    bus = open_bus()
    with ThreadPoolExecutor() as pool:
        spinning = pool.submit(bus.spin_once)
        bus.stop()
        assert isinstance(spinning.exception(20.0), StoppedError)


def test_a_signal_that_does_not_interrupt_a_wait_still_ends_it(open_bus):
    # taken on another thread, it leaves this one waiting, as one just before the wait does
    bus = open_bus()
    gate = threading.Semaphore(0)
    hung = []

    def interrupt():
        gate.acquire()
        signal.pthread_kill(threading.get_ident(), signal.SIGUSR1)

    def give_up():
        hung.append(True)
        bus.stop()

    before = signal.signal(signal.SIGUSR1, lambda *_: bus.stop())
    thread, guard = threading.Thread(target=interrupt), threading.Timer(10.0, give_up)
    thread.start()
    guard.start()
    try:
        gate.release()
        with pytest.raises(StoppedError):
            bus.spin_once()
    finally:
        guard.cancel()
        signal.signal(signal.SIGUSR1, before)
        thread.join()
        guard.join()
    assert not hung


def test_when_a_subscription_is_no_key_expression_expect_one_line(open_bus):
    text = error_of(BusError, lambda: open_bus().subscribe_bytes("/cmd_vel", print))
    assert text.startswith("'/cmd_vel' is not a key expression: ")
    assert ".rs" not in text


def test_a_robots_keys_are_in_its_namespace_within_that_of_the_session(open_bus):
    name = f"test{secrets.token_hex(6)}"
    root, one = open_bus(namespace=name), open_bus(namespace=f"{name}/one")
    heard, answers = [], []
    commands = keys.of_robot(keys.CMD_VEL, "one")
    root.subscribe(commands, lambda twist, _: heard.append(twist.linear.x))
    root.subscribe(keys.CMD_VEL, lambda twist, _: heard.append("in no one's namespace"))
    root.declare_alive("physics", "one")
    one.subscribe_bytes("odom", lambda key, *_: answers.append(key))
    one.declare_alive("controller")
    wait(one, lambda: "physics" in one.presence.names)
    wait(root, lambda: root.presence.names == {"one/physics", "one/controller"})
    one.put_bytes("cmd_vel", b'{"linear":{"x":0.2}}')
    wait(root, lambda: heard == [0.2])
    root.put_bytes("one/odom", b"{}")
    wait(one, lambda: answers == ["odom"])
    one.put_bytes("cmd_vel", b"{")
    wait(root, lambda: root.refused == {"one/cmd_vel": 1})


def test_a_long_attachment_is_refused_before_it_waits(zenoh_pair, monkeypatch):
    near, far = zenoh_pair.near, zenoh_pair.far
    heard = []
    near.subscribe(keys.CMD_VEL, lambda *_: heard.append("cmd_vel"))
    near.subscribe_bytes("of/ones/own", lambda key, *_: heard.append(key))
    zenoh_pair.link()
    monkeypatch.setattr(base, "decode_sample", None)  # none of them is decoded
    for key in ("cmd_vel", "of/ones/own"):
        far.put_bytes(key, b"{}", attachment=bytes(MAX_ENVELOPE_BYTES))
    zenoh_pair.settle()
    wait(near, lambda: near.refused.total() == 2)
    assert not heard


def test_a_sample_of_bytes_counts_with_its_key_its_encoding_and_its_attachment(zenoh_pair):
    near, far, heard = zenoh_pair.near, zenoh_pair.far, []
    most = 500 + len("of/ones/own") + len("text/plain") + 16 + 2
    for backlog in (most, most - 1):
        near.subscribe_bytes("of/ones/own", lambda *sample: heard.append(sample), backlog)
    zenoh_pair.link()
    far.put_bytes("of/ones/own", b"{}", "text/plain", bytes(16))
    zenoh_pair.settle()
    assert heard == [("of/ones/own", b"{}", "text/plain", bytes(16))]
    assert near.refused == {"of/ones/own": 1}
