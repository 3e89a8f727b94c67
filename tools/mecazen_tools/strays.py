"""Samples on keys that nobody takes, but that are like one on which anyone may drive.

Who mistypes a key with a tool such as `zenoh-cli` is told nothing: the sample goes nowhere. To hear
of all keys would cost each publisher of the loop another recipient, so only such expressions are
heard on which no node publishes: what is an `open` topic but for a slip.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Iterator, Sequence

from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.keys import CALLS, TOPICS, topic_of
from mecazen.robots import join_key, split_key
from mecazen.text import shortened

BACKLOG_BYTES = 1 << 16
"""So much waits at most on each expression."""
KEYS = 20
"""So many keys are told of, since a stranger can make up any number."""
AFFIX = 3
"""So many characters at the begin or at the end tell what a name was to be."""

OPEN = tuple(topic.key for topic in TOPICS if topic.open)


class Strays:
    """Hears them, and tells of each key once.

    Args:
        bus: That of all robots.
        robots: Their names.
        given: The open keys that nodes of the scenario publish on.
        tell: Takes a line that says which key it is, and which one may be meant.
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
    """Yield expressions of the keys of which a part begins or ends as that of a key does."""
    parts = key.split("/")
    for at, part in enumerate(parts):
        for like in (f"{part[:AFFIX]}$*", f"$*{part[-AFFIX:]}"):
            yield "/".join([*parts[:at], like, *parts[at + 1 :]])


def unknown_key(key: str, robots: Sequence[str] = ("",)) -> str | None:
    """Return in a line that no node of ours takes or gives a key, and which one is like it.

    None where one does, or may, of a robot of any name. It may be a key of somebody's own, so it
    is no error.
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
    """Return in a line that a key answers queries and carries no samples; None where it does."""
    if all(call.key != key for call in CALLS):
        return None
    asks = "`mecazen sim`, `mecazen param` or a Zenoh tool's get"
    return f"{key}: answers queries and carries no samples; it is asked by {asks}"
