"""Publishes a recording at the pace of its simulated time."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

from mecazen.bus.session import includes
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.wire import NS_PER_S, RefusedError

from mecazen_recorder.reader import Recording, Sample
from mecazen_recorder.sink import RecordingError


def publish(
    recording: Recording,
    bus: ZenohBus,
    keys: Sequence[str] = ("**",),
    *,
    speed: float = 1.0,
    begin_ns: float = 0,
    end_ns: float = math.inf,
    turn: int = 0,
) -> int:
    """Publish the samples of some keys with their original stamps.

    Args:
        recording: The recording to publish.
        bus: The bus on which to publish.
        keys: Key expressions.
        speed: Simulated seconds per wall second.
        begin_ns: See `Recording.samples`.
        end_ns: See `Recording.samples`.
        turn: How often it was published before. It is added to the numbers of the runs, since
            services drop ticks older than the newest of a run.

    Returns:
        The number of samples published.

    Raises:
        RecordingError: Nothing in the recording is on these keys and in this time, or a
            sample is not what its key carries.
    """
    published, pace = 0, _Pace(bus, speed)
    for sample in recording.samples(begin_ns, end_ns):
        if any(includes(expression, sample.key) for expression in keys):
            pace.wait(sample)
            _publish(recording, bus, sample, turn)
            published += 1
    if not published:
        raise RecordingError(f"{recording.path}: nothing on these keys in this time")
    return published


class _Pace:
    """Waits until samples are due."""

    def __init__(self, bus: ZenohBus, speed: float) -> None:
        self._bus = bus
        self._ns_per_s = speed * NS_PER_S
        self._run: int | None = None
        self._begin_s = 0.0
        self._begin_ns: int | None = None

    def wait(self, sample: Sample) -> None:
        """Wait until the time of a sample; a run's first is due at once."""
        run = self._run if sample.stamp is None else sample.stamp.run
        if run != self._run or self._begin_ns is None:
            self._run, self._begin_ns = run, sample.time_ns
            self._begin_s = time.monotonic()
        due_s = self._begin_s + (sample.time_ns - self._begin_ns) / self._ns_per_s
        while (left_s := due_s - time.monotonic()) > 0.0:
            self._bus.spin_once(left_s)


def _publish(recording: Recording, bus: ZenohBus, sample: Sample, turn: int) -> None:
    if turn and sample.stamp is not None:
        run = (sample.stamp.run + turn) % 2**32
        sample = sample._replace(stamp=sample.stamp._replace(run=run))
    try:
        bus.put_bytes(sample.key, *sample.as_published())
    except RefusedError as refusal:
        where = f"{recording.path}: {sample.key} at {sample.time_ns / NS_PER_S} s"
        raise RecordingError(f"{where}: {refusal}") from None
