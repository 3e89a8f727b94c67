"""Handlers on Zenoh's threads: they save processor time per sample, and check its source."""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

import zenoh

from mecazen.bus.base import Presence

ReceivedT = TypeVar("ReceivedT")

BETWEEN_PAUSES = 0.1
"""Time to receive the samples that have gathered during a pause, as a share of the pause."""


_state = threading.local()
"""Marks Zenoh's threads whose Python state is kept; the mark ends with that state."""


def direct(function: Callable[[Any], None]) -> Any:
    """Return a handler that runs on Zenoh's receiving thread, which saves a hop."""

    def receive(received: Any) -> None:
        _keep_state()
        function(received)

    return zenoh.handlers.Callback(receive, indirect=False)


def _keep_state() -> None:
    """Keep Python's state of this thread until the process ends.

    Otherwise Python creates and destroys the state with each call that comes from Zenoh, and the
    system maps and unmaps memory for it. Without this a distributed run of `back` makes 13 % fewer
    ticks a second.
    """
    if not hasattr(_state, "is_kept"):
        _state.is_kept = True
        ctypes.pythonapi.PyGILState_Ensure()


class Pause:
    """Pauses Zenoh's receiving thread, so that samples gather in its socket.

    Waking a thread that sleeps on another core costs a sender 12 to 15 µs, four times as much as
    the rest of sending. A thread that does not wait for its socket is not woken. Without pauses a
    distributed run of `back` makes 6 % fewer ticks a second.

    Args:
        pause_s: Length of a pause [s]; 0: no pauses.
    """

    def __init__(self, pause_s: float) -> None:
        self._pause_s = pause_s
        self._next_s = 0.0

    def after(self, keep: Callable[[ReceivedT], None]) -> Callable[[ReceivedT], None]:
        """Return a handler that keeps samples, and pauses once the gathered samples are kept."""
        if not self._pause_s:
            return keep

        def receive(sample: ReceivedT) -> None:
            keep(sample)
            if time.monotonic() >= self._next_s:
                time.sleep(self._pause_s)
                self._next_s = time.monotonic() + self._pause_s * BETWEEN_PAUSES

        return receive


class Sources:
    """Remembers the session of each service from the first sample of that service.

    `is_second` runs on Zenoh's threads. When a service comes or goes, its session is forgotten,
    since a restarted service has another session. A program that copies a session's identity is
    not detected; only certificates exclude it.
    """

    def __init__(self, presence: Presence) -> None:
        self._presence = presence
        self._alive: set[str] = set()
        self._sessions: dict[str, object] = {}
        presence.on_change.append(self._note_change)

    def is_second(self, service: str, sample: zenoh.Sample) -> bool:
        """Return whether a sample comes from another session than the service's."""
        source = sample.source_info
        session = None if source is None else source.source_id.zid
        return self._sessions.setdefault(service, session) != session

    def _note_change(self) -> None:
        stayed = self._alive & self._presence.names
        self._sessions = {of: one for of, one in self._sessions.items() if of in stayed}
        self._alive = set(self._presence.names)
