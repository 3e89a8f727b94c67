"""Use of the machine by processes, and waits for them."""

import time
from types import SimpleNamespace

import psutil
import pytest
from mecazen.errors import MecazenError
from mecazen_bench import stack
from mecazen_bench.harness import Figure
from mecazen_bench.stack import Usage, spin, spin_until


@pytest.fixture
def clock(monkeypatch):
    """A bus and its wall clock, which each spin advances."""

    def spin_once(seconds):
        clock.now += seconds

    clock = SimpleNamespace(now=10.0, spin_once=spin_once)
    monkeypatch.setattr(stack, "time", SimpleNamespace(perf_counter=lambda: clock.now))
    return clock


def test_usage_is_of_the_time_since_its_beginning_and_sums_have_their_goals(clock, monkeypatch):
    monkeypatch.setattr(stack, "spent_s", lambda process: process.spent_s)
    memory = lambda: SimpleNamespace(pss=3e6)  # noqa: E731
    processes = {
        name: SimpleNamespace(spent_s=1.5, memory_full_info=memory) for name in ("one", "two")
    }
    usage = Usage(processes)
    clock.now += 2.0
    processes["one"].spent_s += 0.5
    processes["two"].spent_s += 0.1
    assert usage.core_percent() == pytest.approx({"one": 25.0, "two": 5.0})
    rows = usage.rows((None, 40.0), "less", total="less")
    assert rows["one"]["MB"] == Figure(3.0, "less")
    assert rows["all"]["MB"] == Figure(6.0, "less")
    assert rows["all"][stack.CPU].value == pytest.approx(30.0)
    assert "MB" not in usage.rows("less", "less")["all"]


def test_the_processor_time_of_a_process_is_the_time_that_it_measures_itself():
    before_s = time.process_time()
    spent_s = stack.spent_s(psutil.Process())
    assert before_s <= spent_s <= time.process_time()


def test_what_does_not_come_in_time_is_an_error_with_its_words(clock):
    spin(clock, 0.5)
    assert clock.now == 10.5
    spin_until(clock, lambda: clock.now > 11.0, "never")
    assert clock.now == pytest.approx(11.1)
    with pytest.raises(MecazenError, match=r"^no tick$"):
        spin_until(clock, lambda: False, "no tick")
    assert clock.now == pytest.approx(11.1 + stack.START_S, abs=0.2)
