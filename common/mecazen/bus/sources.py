"""Sessions that publish what a single service publishes: samples of any other are refused."""

from __future__ import annotations

import zenoh

from mecazen.bus.base import Presence


class Sources:
    """Knows the session of each service by the first sample that came from it.

    `is_second` runs on Zenoh's threads. A program that copies the session's identity is not
    noticed: only certificates keep it out.

    Args:
        presence: The services that are alive; one that comes or goes has another session then.
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
