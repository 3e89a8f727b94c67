"""The receiving thread: its pauses, and Python's state of it between two samples."""

import threading
from collections import Counter
from types import SimpleNamespace

import pytest
from mecazen.bus import receiving
from mecazen.bus.receiving import Pause


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
