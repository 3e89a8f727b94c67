"""The bus within one process: a put reaches every subscriber before it returns."""

import pytest
from harness import ask_bytes
from mecazen import keys
from mecazen.bus import StoppedError
from mecazen.errors import BusError
from mecazen.messages import Clock, SimState, StepRequest
from mecazen.wire import Stamp

STAMP = Stamp(0, 1, 0)


def test_a_put_reaches_all_subscribers_in_their_order_as_the_object_itself(bus):
    heard, message = [], Clock()
    for name in "ab":
        bus.subscribe(keys.CLOCK, lambda *sample, name=name: heard.append((name, *map(id, sample))))
    bus.publisher(keys.CLOCK).put(message, STAMP)
    assert heard == [("a", id(message), id(STAMP)), ("b", id(message), id(STAMP))]
    assert not bus.spin_once()  # nothing waits


def test_bytes_on_a_key_without_subscribers_are_lost(bus):
    bus.put_bytes("cmd_vel", b"{}")
    assert not bus.refused


@pytest.mark.parametrize("payload", [b"", b" \n", b"{}"])
def test_an_empty_request_means_the_defaults(bus, payload):
    bus.serve(keys.SIM_STEP, lambda request, reply: reply.answer(SimState(tick=request.ticks)))
    assert ask_bytes(bus, keys.SIM_STEP, payload).tick == 1


@pytest.mark.parametrize("payload", [b'{"ticks":0}', b'{"ticks":"x"}', b"x", b"[]", b"\xc0"])
def test_a_malformed_request_is_refused_and_counted(bus, payload):
    bus.serve(keys.SIM_STEP, lambda _, reply: reply.answer(SimState()))
    with pytest.raises(BusError, match=r"^sim/step: "):
        ask_bytes(bus, keys.SIM_STEP, payload)
    assert bus.refused == {"sim/step": 1}
    assert bus.call(keys.SIM_STEP, StepRequest()) == SimState()


def test_when_a_query_stays_open_expect_that_said(bus):
    bus.serve(keys.SIM_STEP, lambda request, reply: None)
    with pytest.raises(BusError, match=r"^sim/step: not answered$"):
        bus.call(keys.SIM_STEP, StepRequest())


def test_stop_ends_the_next_spin_once(bus):
    bus.stop()
    with pytest.raises(StoppedError):
        bus.spin_once()


def test_after_close_nothing_is_delivered(bus):
    publisher = bus.publisher(keys.CLOCK)
    bus.subscribe(keys.CLOCK, lambda *_: pytest.fail("delivered after close"))
    bus.close()
    publisher.put(Clock(), STAMP)


def test_a_robots_service_is_alive_by_the_name_after_that_of_its_robot(bus):
    bus.declare_alive("target", "one")
    bus.declare_alive("physics")
    assert bus.presence.names == {"one/target", "physics"}
