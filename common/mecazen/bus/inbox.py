"""Queues between Zenoh's threads, which receive samples, and the service's thread.

`receive` and `add` run on Zenoh's threads. They put functions into a queue, and the service's
thread calls these functions.
"""

from __future__ import annotations

import queue
import threading
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Generic, TypeVar

SAMPLE_BYTES = 500
"""Approximate memory of a waiting sample besides its payload [bytes]."""
BACKLOG_BYTES = 1 << 26
"""Maximum size of the waiting samples of a subscription that needs every sample [bytes]."""
SIGNAL_CHECK_S = 0.2
"""Maximum delay of a signal that arrives just before a wait and does not interrupt it [s]."""
WAITING_SAMPLES = 16
"""Maximum number of waiting samples of any other subscription, which takes the newest valid one."""

Queue = queue.SimpleQueue[Callable[[], None]]
SampleT = TypeVar("SampleT")


def next_of(waiting: queue.SimpleQueue[SampleT]) -> SampleT:
    """Wait for the next item of a queue and return it; a signal handler may also add an item."""
    while True:
        with suppress(queue.Empty):
            return waiting.get(timeout=SIGNAL_CHECK_S)


@dataclass
class Refusals:
    """Counts what Zenoh's threads refuse, and reports the counts on the service's thread."""

    ready: Queue
    report: Callable[[str, str, int], None]
    """Function called with a key, a reason and the number of refusals."""
    _counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def add(self, key: str, reason: str) -> None:
        """Count a refusal."""
        with self._lock:
            if not self._counts:
                self.ready.put(self._deliver)
            self._counts[key, reason] += 1

    def _deliver(self) -> None:
        with self._lock:
            counts, self._counts = self._counts, Counter()
        for (key, reason), count in counts.items():
            self.report(key, reason, count)


def _no_samples() -> deque[Any]:
    return deque(maxlen=WAITING_SAMPLES)


@dataclass
class Inbox(Generic[SampleT]):
    """Keeps the newest samples of a topic and delivers the newest valid one.

    A malformed sample never displaces a valid one: if `WAITING_SAMPLES` wait already, the next
    sample is kept only if it is valid.
    """

    ready: Queue
    take: Callable[[SampleT], bool]
    """Delivers a sample; returns whether it was valid."""
    is_good: Callable[[SampleT], bool]
    """Returns whether a sample can be delivered; runs on Zenoh's threads."""
    count_lost: Callable[[int], None] = lambda _: None
    """Function called with the number of samples that newer ones replaced."""
    _displaced: int = 0
    _samples: deque[SampleT] = field(default_factory=_no_samples)
    _announced: bool = False
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def receive(self, sample: SampleT) -> None:
        """Keep a sample, in place of the oldest if the inbox is full and the sample is valid."""
        if not self._keep(sample, displace=False) and self.is_good(sample):
            self._keep(sample, displace=True)

    def _keep(self, sample: SampleT, *, displace: bool) -> bool:
        """Keep a sample if there is room, or the oldest may be displaced."""
        with self._lock:
            if len(self._samples) == WAITING_SAMPLES and not displace:
                return False
            self._displaced += len(self._samples) == WAITING_SAMPLES
            self._samples.append(sample)
            if not self._announced:
                self._announced = True
                self.ready.put(self._deliver)
            return True

    def _deliver(self) -> None:
        with self._lock:
            samples, self._samples = self._samples, _no_samples()
            lost, self._displaced = self._displaced, 0
            self._announced = False
        while samples and not self.take(samples.pop()):
            pass
        if lost := lost + len(samples):
            self.count_lost(lost)


@dataclass
class Backlog(Generic[SampleT]):
    """Keeps every waiting sample of a subscription, up to a number of bytes."""

    ready: Queue
    take: Callable[[SampleT], object]
    size: Callable[[SampleT], int]
    """Returns the size of a sample [bytes]."""
    limit: float
    """Maximum size of all waiting samples [bytes]."""
    refuse: Callable[[], None]
    """Function called for a sample beyond the limit; runs on Zenoh's threads."""
    _bytes: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def receive(self, sample: SampleT) -> None:
        """Keep a sample if there is room for it."""
        size = SAMPLE_BYTES + self.size(sample)
        with self._lock:
            has_room = self._bytes + size <= self.limit
            if has_room:
                self._bytes += size
        if has_room:
            self.ready.put(partial(self._deliver, sample, size))
        else:
            self.refuse()

    def _deliver(self, sample: SampleT, size: int) -> None:
        with self._lock:
            self._bytes -= size
        self.take(sample)
