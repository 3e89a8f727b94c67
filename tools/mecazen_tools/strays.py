"""Samples on keys that no service takes, but that resemble the key of an open topic.

A client that mistypes a key, as with `zenoh-cli`, gets no error: the sample has no recipient. A
subscription to all keys would cost each publisher of the loop another recipient. So this module
subscribes only to misspelt keys of `open` topics, on which no node publishes.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Iterator, Sequence

from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.keys import CALLS, TOPICS, topic_of
from mecazen.robots import join_key, split_key
from mecazen.text import shortened

BACKLOG_BYTES = 1 << 16
"""Maximum size of waiting samples on each expression [bytes]."""
KEYS = 20
"""Maximum number of reported keys; any client can invent keys."""
AFFIX = 3
"""Number of first or last characters that identify a misspelt name."""

OPEN = tuple(topic.key for topic in TOPICS if topic.open)


class Strays:
    """Receives such samples, and reports each key once.

    Args:
        bus: The bus of all robots.
        robots: Their names.
        given: The open keys that nodes of the scenario publish on.
        tell: Function for a line with the key and a similar known key.
    """

    def __init__(
        self,
        bus: ZenohBus,
        robots: Sequence[str],
        given: Collection[str],
        tell: Callable[[str], None],
    ) -> None:
        self._robots = robots
        self._tell = tell
        self._told: set[str] = set()
        for robot in robots:
            for key in OPEN:
                for near in slips(key) if key in given else likes(key):
                    bus.subscribe_bytes(join_key(near, robot), self._take, BACKLOG_BYTES)

    def _take(self, key: str, *_: object) -> None:
        if key in self._told or len(self._told) >= KEYS:
            return
        told = unknown_key(key, self._robots)
        if told is not None:
            self._told.add(key)
            self._tell(told)


def slips(key: str) -> Iterator[str]:
    """Yield a key with one slip in its name: a character left out, doubled, or swapped."""
    folder, slash, name = key.rpartition("/")
    for at, one in enumerate(name):
        begin, rest = folder + slash + name[:at], name[at + 1 :]
        yield begin + rest
        yield begin + one + one + rest
        if rest:
            yield begin + rest[0] + one + rest[1:]


def likes(key: str) -> Iterator[str]:
    """Yield expressions for keys with a part that begins or ends like a part of this key."""
    parts = key.split("/")
    for at, part in enumerate(parts):
        for like in (f"{part[:AFFIX]}$*", f"$*{part[-AFFIX:]}"):
            yield "/".join([*parts[:at], like, *parts[at + 1 :]])


def unknown_key(key: str, robots: Sequence[str] = ("",)) -> str | None:
    """Return a line with an unknown key and a similar known one.

    None if a node takes or publishes the key, for a robot of any name. A user may have keys of
    their own, so an unknown key is not an error.
    """
    known = [topic.key for topic in TOPICS] + [call.key for call in CALLS]
    parts = key.split("/")
    ends = ["/".join(parts[at:]) for at in range(len(parts))]
    if any(topic_of(end) is not None or end in known for end in ends):
        return None
    robot, name = split_key(key, robots)
    close = difflib.get_close_matches(name, known, n=1)
    meant = f"did you mean {join_key(close[0], robot)}?" if close else "`mecazen topics` shows all"
    return f"{shortened(key)}: no key of mecazen; {meant}"


def asked_only(key: str) -> str | None:
    """Return a warning if a key only answers queries and carries no samples; None otherwise."""
    if all(call.key != key for call in CALLS):
        return None
    asks = "`mecazen sim`, `mecazen param` or a Zenoh tool's get"
    return f"{key}: answers queries and carries no samples; it is asked by {asks}"
