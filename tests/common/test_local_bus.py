"""The bus within one process: one thread, one fixed order."""

import pytest
from mecazen import keys
from mecazen.bus import LocalBus, StoppedError
from mecazen.errors import BusError
from mecazen.messages import Clock, SimState, StepRequest, Time, Twist, Vector3
from mecazen.wire import Stamp

STAMP = Stamp(0, 1, 0)


@pytest.fixture
def bus():
    return LocalBus()


def test_what_a_handler_publishes_comes_after_what_is_pending(bus):
    order = []
    commands = bus.publisher(keys.CMD_VEL)

    def on_clock(clock, stamp):
        order.append(("clock", clock.clock.sec))
        commands.put(Twist(linear=Vector3(x=clock.clock.sec)), stamp)

    bus.subscribe(keys.CLOCK, on_clock)
    bus.subscribe(keys.CMD_VEL, lambda twist, _: order.append(("cmd_vel", twist.linear.x)))
    for tick in (1, 2):
        bus.publisher(keys.CLOCK).put(Clock(Time(tick)), STAMP)
    bus.spin()
    assert order == [("clock", 1), ("clock", 2), ("cmd_vel", 1), ("cmd_vel", 2)]


def test_spin_once_delivers_one(bus):
    clocks = []
    bus.subscribe(keys.CLOCK, lambda clock, _: clocks.append(clock))
    for tick in (1, 2):
        bus.publisher(keys.CLOCK).put(Clock(Time(tick)), STAMP)
    assert bus.spin_once()
    assert clocks == [Clock(Time(1))]
    assert bus.spin_once()
    assert not bus.spin_once()


def test_bytes_on_a_key_that_nobody_subscribes_are_lost(bus):
    bus.put_bytes("cmd_vel", b"{}")
    bus.spin()
    assert not bus.refused


@pytest.mark.parametrize("payload", [b"", b" \n", b"{}", b"\x80"])
def test_an_empty_request_means_the_defaults(bus, payload):
    bus.serve(keys.SIM_STEP, lambda request, reply: reply.answer(SimState(tick=request.ticks)))
    assert bus.call_bytes(keys.SIM_STEP, payload).tick == 1


@pytest.mark.parametrize("payload", [b'{"ticks":0}', b'{"ticks":"x"}', b"x", b"[]", b"\xc0"])
def test_a_malformed_request_is_refused_and_counted(bus, payload):
    bus.serve(keys.SIM_STEP, lambda _, reply: reply.answer(SimState()))
    with pytest.raises(BusError, match=r"^sim/step: "):
        bus.call_bytes(keys.SIM_STEP, payload)
    assert bus.refused == {"sim/step": 1}
    assert bus.call(keys.SIM_STEP, StepRequest()) == SimState()


def test_when_a_query_stays_open_expect_that_said(bus):
    bus.serve(keys.SIM_STEP, lambda request, reply: None)
    with pytest.raises(BusError, match=r"^sim/step: not answered$"):
        bus.call(keys.SIM_STEP, StepRequest())


def test_stop_ends_the_next_spin_once(bus):
    bus.publisher(keys.CLOCK).put(Clock(), STAMP)
    bus.stop()
    with pytest.raises(StoppedError):
        bus.spin_once()


def test_close_drops_what_is_pending(bus):
    bus.subscribe(keys.CLOCK, lambda *_: pytest.fail("delivered after close"))
    bus.publisher(keys.CLOCK).put(Clock(), STAMP)
    bus.close()
    assert not bus.spin_once()


def test_a_bus_beside_has_keys_of_its_own_and_is_delivered_with_the_other():
    bus = LocalBus()
    one = bus.namespaced("one")
    heard = []
    for name, where in (("", bus), ("one", one), ("two", bus.namespaced("two"))):
        where.subscribe(keys.CLOCK, lambda message, stamp, name=name: heard.append(name))
    assert bus.namespaced("one") is one
    assert bus.namespaced("") is bus
    one.publisher(keys.CLOCK).put(Clock(), Stamp(0, 1, 0))
    bus.publisher(keys.CLOCK).put(Clock(), Stamp(0, 1, 0))
    assert bus.spin_once()
    assert one.spin_once()
    assert not bus.spin_once()
    assert heard == ["one", ""]
    one.declare_alive("target")
    assert (bus.presence.names, one.presence.names) == (set(), {"target"})
    bus.stop()
    with pytest.raises(StoppedError):
        one.spin_once()


def test_bytes_reach_a_bus_beside_by_a_key_that_begins_with_its_name():
    bus, heard = LocalBus(), []
    for name in ("", "one"):
        bus.namespaced(name).subscribe(keys.CLOCK, lambda *_, name=name: heard.append(name))
    bus.put_bytes("one/clock", b"{}")
    bus.put_bytes("two/clock", b"{}")
    bus.put_bytes("clock", b"{}")
    bus.spin()
    assert heard == ["one", ""]
