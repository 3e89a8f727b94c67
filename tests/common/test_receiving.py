"""The receiving thread: its pauses, Python's state of it, and the session of each service."""

import threading
from collections import Counter
from types import SimpleNamespace

import pytest
from harness import wait
from mecazen import keys
from mecazen.bus import receiving
from mecazen.bus.receiving import Pause
from mecazen.messages import Odometry
from mecazen.wire import Stamp


@pytest.fixture
def time(monkeypatch):
    """Return a clock that each sleep advances."""
    time = SimpleNamespace(now=1.0, slept=[])
    time.monotonic = lambda: time.now

    def sleep(seconds):
        time.slept.append(seconds)
        time.now += seconds

    time.sleep = sleep
    monkeypatch.setattr(receiving, "time", time)
    return time


def test_without_a_pause_samples_are_kept_by_the_same_function(time):
    assert Pause(0.0).after(print) is print
    assert not time.slept


def test_a_pause_follows_once_what_has_gathered_is_kept(time):
    kept: list[int] = []
    receive = Pause(0.02).after(kept.append)
    receive(0)
    assert time.slept == [0.02]
    time.now += 0.0019  # within a tenth of the pause: these had gathered
    receive(1)
    assert time.slept == [0.02]
    time.now += 0.0002
    receive(2)
    assert time.slept == [0.02, 0.02]
    assert kept == [0, 1, 2]


def test_python_keeps_its_state_of_a_receiving_thread_from_one_sample_to_the_next(
    zenoh_pair, monkeypatch
):
    local, received = threading.local(), []

    def bytes_of(_):  # counts on the receiving thread
        local.number = getattr(local, "number", 0) + 1  # a part of that state
        received.append((threading.get_ident(), local.number))
        return 0

    monkeypatch.setattr("mecazen.bus.zenoh_bus.bytes_of", bytes_of)
    zenoh_pair.near.subscribe_bytes("samples", lambda *_: None)
    zenoh_pair.link()
    for _ in range(20):
        zenoh_pair.far.put_bytes("samples", b"")
        zenoh_pair.settle()
    numbers = Counter()  # the router's runtime, which this process shares, has several threads
    for thread, number in received:
        numbers[thread] += 1
        assert number == numbers[thread]
    assert numbers.total() == 20


AT = Stamp(0, 7, 3)


def heard_of(bus, service):
    """Return the senders, by their frame, of the odometry that counts as the service's."""
    heard = []
    bus.subscribe(keys.ODOM, lambda odom, _: heard.append(odom.child_frame_id), of=service)
    bus.declare_alive("ear")
    return heard


def say(bus, name, stamp=AT):
    bus.publisher(keys.ODOM).put(Odometry(child_frame_id=name), stamp)


def meet(ear, bus, name):
    bus.declare_alive(name)
    wait(bus, lambda: "ear" in bus.presence.names)
    wait(ear, lambda: name in ear.presence.names)


@pytest.fixture
def three(open_bus):
    """Three sessions, the first of which hears the odometry of the controller, and the senders."""
    ear, one, other = open_bus(), open_bus(), open_bus()
    return ear, one, other, heard_of(ear, "controller")


def test_samples_of_another_session_are_refused_and_counted(three):
    ear, service, other, heard = three
    meet(ear, service, "controller")
    meet(ear, other, "other")
    say(service, "service")
    wait(ear, lambda: heard == ["service"])
    say(other, "other")
    other.put_bytes("odom", b"{}")  # as by the Zenoh command line, which names no source
    wait(ear, lambda: ear.refused["odom"] == 2)
    say(service, "service")
    wait(ear, lambda: heard == ["service"] * 2)


def test_a_service_that_has_started_again_has_another_session(three):
    ear, service, again, heard = three
    meet(ear, service, "controller")
    say(service, "service")
    wait(ear, lambda: heard == ["service"])
    service.close()
    wait(ear, lambda: "controller" not in ear.presence.names)
    meet(ear, again, "controller")
    say(again, "again")
    wait(ear, lambda: heard == ["service", "again"])
    assert not ear.refused


def test_a_session_that_publishes_before_the_service_comes_does_not_keep_it_out(three):
    ear, service, other, heard = three
    meet(ear, other, "other")
    say(other, "other")
    wait(ear, lambda: heard == ["other"])
    meet(ear, service, "controller")
    say(service, "service")
    wait(ear, lambda: heard == ["other", "service"])
