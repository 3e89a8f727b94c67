"""Readiness of services, and the clock's wait for those that need every sample."""

import threading

import msgspec
import pytest
from harness import wait
from mecazen.bus import LocalBus
from mecazen.config import RobotConfig, SimConfig, StartConfig
from mecazen.errors import BusError
from mecazen.runtime.pace import TICKS_APART, Pace, declare_every, serve_every
from mecazen.runtime.readiness import announce_readiness

PATIENCE_S = 0.2


@pytest.fixture
def pace(zenoh_pair):
    """The pace of a clock, which knows a recorder on the pair's near bus."""
    declare_every(zenoh_pair.near, "recorder", "two")
    zenoh_pair.link()
    wait(zenoh_pair.far, lambda: "two/recorder/every" in zenoh_pair.far.presence.names)
    return Pace(zenoh_pair.far, PATIENCE_S)


def test_the_clock_waits_until_earlier_samples_are_taken(zenoh_pair, pace, caplog):
    taken = threading.Event()
    zenoh_pair.near.queue.put(taken.set)  # as a sample that has arrived
    with zenoh_pair.serving():
        pace.keep(TICKS_APART)
        assert taken.is_set()
    assert not caplog.records


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


def test_the_clock_does_not_wait_for_a_service_that_has_gone(zenoh_pair, pace, caplog):
    zenoh_pair.near.close()
    wait(zenoh_pair.far, lambda: "two/recorder/every" not in zenoh_pair.far.presence.names)
    pace.keep(TICKS_APART)
    assert not caplog.records


class LossyBus(LocalBus):
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
    bus, services = LocalBus(), ("controller", *services)
    scenario = msgspec.structs.replace(scenario, services=services, sim=SimConfig(mode=mode))
    announce_readiness(bus, "controller", "", scenario)
    for name in ("stranger", *awaited):
        assert "controller/ready" not in bus.presence.names
        bus.declare_alive(name)
    assert bus.presence.names == {"controller/ready", *awaited}


def test_a_robots_service_waits_for_those_of_all_robots(scenario):
    bus = LocalBus()
    robots = (RobotConfig("one"), RobotConfig("two", start=StartConfig(y_m=2.0)))
    scenario = msgspec.structs.replace(scenario, services=("target",), robots=robots)
    announce_readiness(bus, "target", "one", scenario)
    assert not bus.presence.names
    bus.declare_alive("target", "two")
    assert bus.presence.names == {"two/target", "one/target/ready"}
