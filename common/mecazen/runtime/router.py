"""The Zenoh router that processes and tools connect to."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable

from mecazen import log
from mecazen.bus.session import open_session
from mecazen.config import Scenario
from mecazen.runtime.report import Report, Reporter

logger = logging.getLogger(__name__)

SAMPLES_PER_TICK = 10
"""In real time, the number of samples per tick that a router accepts on a key from each link."""


def run_router(scenario: Scenario, reporter: Reporter) -> None:
    """Run the router until a signal ends it.

    Raises:
        BusError: The port is taken, or an endpoint is insecure.
    """
    log.set_up("router", lambda: 0.0, reporter.log_level)
    stopped = _StopFlag()
    stop_on_signals(stopped.set)
    sim = scenario.sim
    # lockstep has no rate: ticks may be fast, and a dropped sample would be awaited in vain
    most_hz = SAMPLES_PER_TICK * sim.speed / sim.tick_s if sim.mode == "real_time" else None
    with open_session(scenario.bus, "router", "router", most_hz=most_hz, robots=scenario.names):
        logger.info("msg=started endpoints=%s", ",".join(scenario.bus.router_endpoints or ()))
        reporter.tell(Report("started"))
        stopped.wait()


class _StopFlag:
    """Waits for signals without polling.

    `signal.pause` would miss a signal that arrives just before it. A byte in a pipe stays there.
    """

    def __init__(self) -> None:
        self._out, self._in = os.pipe()
        os.set_blocking(self._in, False)
        signal.set_wakeup_fd(self._in)
        self._stopped = False

    def set(self) -> None:
        self._stopped = True

    def wait(self) -> None:
        while not self._stopped:
            os.read(self._out, 1)


def stop_on_signals(stop: Callable[[], None]) -> None:
    """Call `stop` on SIGINT, SIGTERM and SIGHUP."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: stop())
