"""The router: its limit of samples, and its end on a signal."""

import logging
import os
import signal
from contextlib import nullcontext
from types import SimpleNamespace

import msgspec
import pytest
from mecazen.config import SimConfig
from mecazen.runtime import router


@pytest.fixture
def opened(monkeypatch):
    """The settings of sessions that were opened; handlers and logs are as before when it ends."""
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.getsignal(number) for number in numbers}
    opened = []

    def open_session(*args, **settings):
        opened.append(settings)
        return nullcontext()

    monkeypatch.setattr(router, "open_session", open_session)
    yield opened
    signal.set_wakeup_fd(-1)
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("sim", "most_hz"),
    [
        (SimConfig(), 1000.0),  # ten samples in each tick of 10 ms
        (SimConfig(tick_s=0.02, speed=4.0), 2000.0),
        (SimConfig(mode="lockstep"), None),
    ],
)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_even_if_it_comes_before_it_waits(opened, scenario, sim, most_hz, number):
    told = []

    def tell(report):
        told.append(report.kind)
        os.kill(os.getpid(), number)

    reporter = SimpleNamespace(log_level=logging.WARNING, tell=tell)
    router.run_router(msgspec.structs.replace(scenario, sim=sim), reporter)
    assert told == ["started"]
    assert opened == [{"most_hz": most_hz, "robots": ("",)}]
