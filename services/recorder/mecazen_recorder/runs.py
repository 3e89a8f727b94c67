"""Runs that are not known yet; any client can invent run numbers."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

from mecazen.bus.zenoh_bus import Sent, bytes_of

FIRST_BYTES = 1 << 22
"""Maximum size of the first samples that wait for a second sample of their run [bytes]."""


class FirstSamples:
    """Keeps the first sample of each run until the second comes, up to `FIRST_BYTES`.

    A node publishes more than one sample in a run. A client that invents a run number for each
    sample therefore begins no run.

    Args:
        refuse: Called with the key of a sample that has waited too long.
    """

    def __init__(self, refuse: Callable[[str], None]) -> None:
        self._refuse = refuse
        self._samples: OrderedDict[int, Sent] = OrderedDict()
        self._bytes = 0

    def second(self, run: int, sample: Sent) -> Sent | None:
        """Return the first sample of a run if this is the second one; keep this one otherwise."""
        first = self._samples.pop(run, None)
        if first is not None:
            self._bytes -= bytes_of(first)
            return first
        self._samples[run] = sample
        self._bytes += bytes_of(sample)
        while self._bytes > FIRST_BYTES:
            self._drop()
        return None

    def close(self) -> None:
        """Refuse all waiting samples."""
        while self._samples:
            self._drop()

    def _drop(self) -> None:
        _, sample = self._samples.popitem(last=False)
        self._bytes -= bytes_of(sample)
        self._refuse(sample[0])
