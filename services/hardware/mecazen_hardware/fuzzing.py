"""Damaged frames for the receiver of the X3, and counts of what it accepts."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable

import msgspec

from mecazen_hardware.rosmaster_x3 import COUNTS, TO_HOST, Decoder, frame

HEADER = 5
"""Position of the first byte in which two frames differ, counted from 1."""
LOST_AT_MOST = 2
"""Maximum number of intact frames that may be lost after damage."""


class Fuzzed(msgspec.Struct):
    """Counts of a fuzzed receiver."""

    frames: int = 0
    """Frames that were sent, damaged or not."""
    damaged: int = 0
    whole: int = 0
    """Frames that were sent intact."""
    whole_received: int = 0
    received_by_chance: int = 0
    """Received frames that were not sent: damage that left or produced a valid checksum."""
    largest_loss: int = 0
    """Maximum number of intact frames lost in a row."""


def _flip(draw: random.Random, sent: bytes, other: bytes) -> bytes:
    """Return a frame with some changed bytes."""
    del other
    damaged = bytearray(sent)
    for _ in range(draw.randint(1, 4)):
        damaged[draw.randrange(len(damaged))] ^= draw.randrange(1, 256)
    return bytes(damaged)


def _cut(draw: random.Random, sent: bytes, other: bytes) -> bytes:
    """Return a frame that ends early."""
    del other
    return sent[: draw.randrange(len(sent))]


def _merge(draw: random.Random, sent: bytes, other: bytes) -> bytes:
    """Return the beginning of a frame with the end of another one."""
    return sent[: draw.randrange(len(sent))] + other[draw.randrange(HEADER, len(other)) :]


def _garbage(draw: random.Random, sent: bytes, other: bytes) -> bytes:
    """Return random bytes, which begin like a frame half of the time."""
    del other
    return (sent[:2] if draw.random() < 0.5 else b"") + draw.randbytes(draw.randrange(40))


DAMAGE: tuple[Callable[[random.Random, bytes, bytes], bytes], ...] = (_flip, _cut, _merge, _garbage)


def fuzz(frames: int, seed: int) -> Fuzzed:
    """Send frames, half of them damaged, in chunks of random size; return the counts."""
    draw, decoder, found = random.Random(seed), Decoder(), Fuzzed()  # noqa: S311  # no secret
    waiting: list[tuple[int, ...]] = []
    stream = bytearray()
    other = frame(COUNTS, bytes(16), to=TO_HOST)
    for _ in range(frames):
        counts = struct.unpack("<4i", draw.randbytes(16))
        sent = frame(COUNTS, struct.pack("<4i", *counts), to=TO_HOST)
        found.frames += 1
        if draw.random() < 0.5:
            found.damaged += 1
            stream += draw.choice(DAMAGE)(draw, sent, other)
        else:
            found.whole += 1
            waiting.append(counts)
            stream += sent
        other = sent
        if len(stream) > draw.randrange(64):
            _take(decoder, bytes(stream), waiting, found)
            stream.clear()
    _take(decoder, bytes(stream) + bytes(64), waiting, found)
    found.largest_loss = max(found.largest_loss, len(waiting))
    return found


def _take(decoder: Decoder, data: bytes, waiting: list[tuple[int, ...]], found: Fuzzed) -> None:
    for received in decoder.feed(data):
        if received.payload in waiting:
            lost = waiting.index(received.payload)
            found.largest_loss = max(found.largest_loss, lost)
            found.whole_received += 1
            del waiting[: lost + 1]
        else:
            found.received_by_chance += 1
