"""Which samples of runs that are not known yet are kept."""

import pytest
from mecazen.bus.zenoh_bus import bytes_of
from mecazen_recorder import runs
from mecazen_recorder.runs import FirstSamples


def sample(key):
    return key, b"12345678", "", None


@pytest.fixture
def refused():
    return []


@pytest.fixture
def firsts(refused):
    return FirstSamples(refused.append)


def test_the_second_sample_of_a_run_brings_the_first(firsts, refused):
    assert firsts.second(1, sample("odom")) is None
    assert firsts.second(2, sample("clock")) is None
    assert firsts.second(1, sample("cmd_vel")) == sample("odom")
    firsts.close()
    assert refused == ["clock"]


def test_where_more_wait_than_there_is_room_for_the_oldest_is_refused(firsts, refused, monkeypatch):
    # two of 8 bytes with a key of one
    monkeypatch.setattr(runs, "FIRST_BYTES", 2 * bytes_of(sample("a")))
    for run, key in enumerate("abc"):
        firsts.second(run, sample(key))
    assert refused == ["a"]
    assert firsts.second(1, sample("d")) == sample("b")  # which makes room
    firsts.second(3, sample("e"))
    assert refused == ["a"]
