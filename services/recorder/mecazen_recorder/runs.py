"""Runs that are not known yet, of which a stranger can make up any number."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

from mecazen.bus.inbox import SAMPLE_BYTES
from mecazen.bus.zenoh_bus import Sent, bytes_of

FIRST_BYTES = 1 << 22
"""So much waits at most of runs of which nothing else has come yet."""


class FirstSamples:
    """Keeps the first sample of each run until the second one comes, up to a number of bytes.

    Who makes up a run for each sample begins none: a node says more than one thing in a run.

    Args:
        refuse: Called with the key of a sample that has waited too long.
    """

    def __init__(self, refuse: Callable[[str], None]) -> None:
        self._refuse = refuse
        self._samples: OrderedDict[int, Sent] = OrderedDict()
        self._bytes = 0

    def second(self, run: int, sample: Sent) -> Sent | None:
        """Return the first sample of a run that this is the second of, or keep this one."""
        first = self._samples.pop(run, None)
        if first is not None:
            self._bytes -= SAMPLE_BYTES + bytes_of(first)
            return first
        self._samples[run] = sample
        self._bytes += SAMPLE_BYTES + bytes_of(sample)
        while self._bytes > FIRST_BYTES:
            self._drop()
        return None

    def close(self) -> None:
        """Refuse what waits."""
        while self._samples:
            self._drop()

    def _drop(self) -> None:
        _, sample = self._samples.popitem(last=False)
        self._bytes -= SAMPLE_BYTES + bytes_of(sample)
        self._refuse(sample[0])
