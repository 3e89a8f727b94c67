"""Flow control in lockstep: the clock waits for services that need every sample.

A full link drops samples. So a recorder, and a service that the world does not wait for, answer a
query of the clock every `TICKS_APART` ticks, once they have taken all earlier samples. Links can
queue the samples of that many ticks.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable

from mecazen.bus import Bus
from mecazen.errors import BusError
from mecazen.keys import Call
from mecazen.messages import Empty
from mecazen.robots import join_key

EVERY = "every"
"""`<name>/every` is the liveliness token of a service that needs every sample, and the key on which
it answers the clock."""
RECORD = "record"
"""Name of the command `mecazen record`, which needs every sample and is in no scenario."""
TICKS_APART = 64
"""Number of ticks from one query to the next."""
SILENT_S = 0.1
"""Timeout of the query to a service that did not answer the last one [s]."""

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
