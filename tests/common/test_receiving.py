"""Pauses of the receiving thread: after what has gathered, and none where none is wanted."""

from types import SimpleNamespace

import pytest
from mecazen.bus import receiving
from mecazen.bus.receiving import Pause


@pytest.fixture
def time(monkeypatch):
    """A clock that goes on by what is slept."""
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
