"""Publishes a recording at the pace of its simulated time."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

from mecazen.bus.session import includes
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.wire import NS_PER_S

from mecazen_recorder.reader import Recording
from mecazen_recorder.writer import RecordingError


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
    """Publish the samples of some keys with their original stamps; return their number.

    `speed` is in simulated seconds per wall second; for the times see `Recording.samples`.
    `turn`, the number of earlier publications, is added to the numbers of the runs, since services
    drop ticks older than the newest tick of a run.

    Raises:
        RecordingError: The recording has no sample on these keys within these times, or the
            type of a sample does not match its key.
    """
    published, run = 0, None
    start_s, start_ns = 0.0, math.nan  # begin of the run
    for sample in recording.samples(begin_ns, end_ns):
        if not any(includes(expression, sample.key) for expression in keys):
            continue
        if recording.is_foreign and sample.kind is None:  # without content
            continue
        stamp = sample.stamp
        if math.isnan(start_ns) or (stamp is not None and stamp.run != run):
            start_s, start_ns = time.monotonic(), sample.time_ns
        if stamp is not None:
            run = stamp.run
            stamp = stamp._replace(run=(run + turn) % 2**32)
        due_s = start_s + (sample.time_ns - start_ns) / (speed * NS_PER_S)
        while (left_s := due_s - time.monotonic()) > 0.0:
            bus.spin_once(left_s)
        with recording.reading(sample):
            bus.put_bytes(sample.key, *sample._replace(stamp=stamp).as_published())
        published += 1
    if not published:
        raise RecordingError(f"{recording.path}: nothing on these keys in this time")
    return published
