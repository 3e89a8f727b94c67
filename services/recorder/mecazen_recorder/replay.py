"""Publishes a recording at the pace of its simulated time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

from mecazen.bus.session import includes
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.messages import Header, Message, Time
from mecazen.wire import JSON_ENCODING, NS_PER_S, encode
from msgspec.structs import replace

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
    live_ns: Callable[[], int] | None = None,
) -> int:
    """Publish the samples of some keys with their original stamps; return their number.

    With `live_ns`, the time of a running robot [ns], samples replace its sensors: they have no
    stamp, and the times in their headers are shifted to the robot's time.

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
        before, run = run, run if sample.stamp is None else sample.stamp.run
        if run != before or math.isnan(start_ns):
            start_s, start_ns = time.monotonic(), sample.time_ns
        due_s = start_s + (sample.time_ns - start_ns) / (speed * NS_PER_S)
        while (left_s := due_s - time.monotonic()) > 0.0:
            bus.spin_once(left_s)
        if live_ns is not None and sample.kind is not None:
            with recording.reading(sample):
                message = _restamped(sample.message(sample.kind), sample.time_ns, live_ns())
            bus.put_bytes(sample.key, encode(message), JSON_ENCODING)
            published += 1
            continue
        stamp = sample.stamp
        if stamp is not None:
            stamp = stamp._replace(run=(stamp.run + turn) % 2**32)
        with recording.reading(sample):
            bus.put_bytes(sample.key, *sample._replace(stamp=stamp).as_published())
        published += 1
    if not published:
        raise RecordingError(f"{recording.path}: nothing on these keys in this time")
    return published


def _restamped(message: Message, recorded_ns: int, now_ns: int) -> Message:
    """Return a message whose header is as old now as it was in the recording."""
    header = getattr(message, "header", None)
    if not isinstance(header, Header):
        return message
    time_ns = max(now_ns - recorded_ns + header.stamp.ns, 1)  # 0 would be no time
    return replace(message, header=replace(header, stamp=Time.from_ns(time_ns)))
