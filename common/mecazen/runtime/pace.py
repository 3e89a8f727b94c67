"""Conditions for the next tick: ready services, services that need every sample, the wall clock.

A service declares a liveliness token once it has seen all other services. In lockstep, a full link
drops samples. So a recorder, and a service that the world does not wait for, answer a query of the
clock every `TICKS_APART` ticks, once they have taken all earlier samples. Links can queue the
samples of that many ticks.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable

from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.errors import BusError
from mecazen.graph import OBSERVERS
from mecazen.keys import Call
from mecazen.messages import Empty
from mecazen.robots import join_key

READY = "ready"
"""A liveliness token `<name>/ready` means that its holder has seen all other services."""
EVERY = "every"
"""`<name>/every` is the liveliness token of a service that needs every sample, and the key on which
it answers the clock."""
RECORD = "record"
"""Name of the command `mecazen record`, which needs every sample and is in no scenario."""
TICKS_APART = 64
"""Number of ticks from one query to the next."""
SILENT_S = 0.1
"""Timeout of the query to a service that did not answer the last one [s]."""
MAX_LAG_S = 1.0
"""Lag beyond which the schedule restarts instead of catching up [s]."""
RTF_WINDOW_S = 1.0
"""Minimum time over which the real-time factor is measured [s]."""

logger = logging.getLogger(__name__)


def _call(name: str) -> Call[Empty, Empty]:
    return Call(name, Empty, Empty, "answers once all earlier samples are taken")


def serve_every(bus: Bus, name: str, robot: str = "") -> None:
    """Answer the clock once a service has taken all earlier samples."""
    bus.serve(_call(join_key(f"{name}/{EVERY}", robot)), lambda _, reply: reply.answer(Empty()))


def announce_every(bus: Bus, name: str, robot: str = "") -> None:
    """Make the clock wait for a service, whose subscriptions the bus already has."""
    bus.declare_alive(f"{name}/{EVERY}", robot)


def declare_every(bus: Bus, name: str, robot: str = "") -> None:
    """Make the clock wait for an observer, and answer it."""
    serve_every(bus, name, robot)
    announce_every(bus, name, robot)


class Pace:
    """Makes the clock wait for services that need every sample, at most `patience_s` for each."""

    def __init__(self, bus: Bus, patience_s: float) -> None:
        self._bus, self._patience_s = bus, patience_s
        self._silent: set[str] = set()

    def keep(self, tick: int) -> None:
        """Wait before a tick, if one is due, until all samples so far have been taken."""
        if tick % TICKS_APART:
            return
        for name in sorted(n for n in self._bus.presence.names if n.endswith(f"/{EVERY}")):
            timeout_s = SILENT_S if name in self._silent else self._patience_s
            try:
                self._ask(name, name, timeout_s)
                self._silent.discard(name)
            except BusError:
                if name in self._bus.presence.names - self._silent:
                    self._silent.add(name)
                    service = name.removesuffix(f"/{EVERY}")
                    problem = f"going on without {service}, silent: samples may be lost"
                    logger.warning("msg=%r", problem)

    def confirm(self, names: Iterable[str]) -> None:
        """Wait until services have taken all samples so far.

        Raises:
            BusError: A service does not answer.
        """
        for name in names:
            self._ask(f"{name}/{EVERY}", name, self._patience_s)

    def _ask(self, key: str, token: str, timeout_s: float) -> None:
        """Query a service, again if it is alive: a peer's query may end while links change."""
        end_s = time.monotonic() + timeout_s
        left_s = timeout_s
        while True:
            try:
                self._bus.call(_call(key), Empty(), left_s)
            except BusError:
                self._bus.drain()  # it may just have gone
                left_s = end_s - time.monotonic()
                if token not in self._bus.presence.names or left_s <= 0.0:
                    raise
            else:
                return


def announce_readiness(bus: Bus, service: str, robot: str, scenario: Scenario) -> None:
    """Declare `<service>/ready` once every other service of the scenario is seen alive.

    In real time the service does not wait for observers, since no service needs them. From now on
    the bus notes only tokens of the scenario.

    A service that sees another's token has a link to it and knows its subscriptions. Once all
    services are ready, all links exist, so no first sample is lost.
    """
    services = {join_key(*part) for part in scenario.parts}
    tokens = services | {*OBSERVERS, RECORD}
    bus.presence.known = tokens | {f"{name}/{state}" for name in tokens for state in (READY, EVERY)}
    awaited = services - {join_key(service, robot)}
    if scenario.sim.mode == "real_time":
        awaited -= set(OBSERVERS)
    announced = False

    def check() -> None:
        nonlocal announced
        if not announced and awaited <= bus.presence.names:
            announced = True
            bus.declare_alive(f"{service}/{READY}", robot)

    bus.presence.on_change.append(check)
    check()


class Schedule:
    """Ticks of `tick_s` simulated seconds at `speed` simulated seconds per wall second.

    Due times are computed from one start time, so small delays do not accumulate.
    """

    def __init__(self, tick_s: float, speed: float) -> None:
        self.speed = speed
        self.rtf = 0.0
        """Real-time factor over about the last second, or since the first tick; 0 before it."""
        self._is_first_window = True
        self._tick_s = tick_s
        self._period_s = tick_s / speed
        self.restart(0)

    def restart(self, tick: int) -> None:
        """Restart the schedule, with `tick` due now."""
        now = time.monotonic()
        self._begin_s, self._begin_tick = now, tick
        self._published_s = now
        self._window_s, self._window_tick = now, tick

    def published(self, tick: int) -> None:
        """Note that the state of `tick` is published."""
        now = time.monotonic()
        self._published_s = now
        elapsed = now - self._window_s
        is_over = elapsed >= RTF_WINDOW_S
        if is_over or (self._is_first_window and elapsed):
            self.rtf = (tick - self._window_tick) * self._tick_s / elapsed
        if is_over:
            self._window_s, self._window_tick, self._is_first_window = now, tick, False
        if now - self._due_s(tick) > MAX_LAG_S:
            self.restart(tick)

    def wait_s(self, tick: int, *, answered: bool) -> float:
        """Return the time to wait before the tick after `tick` [s]; no wait if 0 or less.

        A schedule that is behind continues as soon as the tick is answered, but gives the other
        services at least half a period to answer.
        """
        due_s = self._due_s(tick + 1)
        if not answered:
            due_s = max(due_s, self._published_s + self._period_s / 2)
        return due_s - time.monotonic()

    def _due_s(self, tick: int) -> float:
        return self._begin_s + (tick - self._begin_tick) * self._period_s
