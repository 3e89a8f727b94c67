"""Payloads that are wrong, or extreme but right, for every service."""

import json
import random
import re
import struct
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any, NamedTuple

import msgspec
import pytest
from mecazen.messages import Message
from mecazen.wire import CDR_ENCODING, JSON_ENCODING, MAX_SAMPLE_BYTES, encode


class Put(NamedTuple):
    """A sample that an external program puts on a key."""

    key: str
    payload: bytes
    encoding: str
    attachment: bytes | None


EXTREME = [1e-320, -0.0, 10.0, 1e5, 1e6, -1e7, 1e155, 1e200, 1e308, -1e308, 1.797e308, -1.797e308]
HOSTILE: list[Any] = [None, True, "", "1", [], {}, [[]], [0.0] * 36, [1e308] * 36, [-1.0] * 36]
HOSTILE += [0, -1, 2**31, 2**32, -(2**31), 2**63, -(2**63), 10**30, *EXTREME]
HOSTILE += [float("nan"), float("inf"), float("-inf"), "\ud7ff", "é" * 50, list(range(200))]
TOKEN = re.compile(rb'"[^"]*"|[-+.\w]+')
"""A name or a value in JSON."""
ODD = (
    b"null", b"true", b'"1"', b"{}", b"[[]]", b'{"x":1}', b"-1", b"2147483648", b"1.5", b"NaN",
    b"-Infinity", b"1e999", b"9" * 400, b"0x10", b".5", b"[0,1]", b'"\\ud7ff"', b"\xff", b"\xc0",
    b"[" * 5000, b'{"header":' * 5000, b'{"linear":[' * 2000,
    b"\xff" * 4, b"\xf0\x7f", b"\xdd\xff\xff\xff\xff", b" " * MAX_SAMPLE_BYTES,
)  # fmt: skip
"""Wrong values, NaN, no UTF-8, deep nesting in JSON and CDR, too much."""
TIMES = (0, 10_000_000, 10**9, 2**31 * 10**9 - 1, 2**31 * 10**9, 2**63 - 1, -1, -(2**63))
"""Times of stamps [ns]."""


def damaged(chance: random.Random, good: bytes) -> bytes:
    """Return a message with a token, any piece, its end or all of it replaced."""
    begin = chance.randrange(len(good))
    spans = [(begin, begin + chance.randrange(4)), (begin, len(good)), (0, len(good))]
    if token := TOKEN.search(good, begin):
        spans.append(token.span())
    begin, end = chance.choice(spans)
    noise = chance.randbytes(1 + chance.randrange(9))
    odd = chance.choice((b"", noise, chance.choice(ODD), good[begin:end]))
    return good[:begin] + odd + good[end:]


def changed(chance: random.Random, message: Message) -> bytes:
    """Return a message with hostile values, or with extreme numbers in the place of numbers."""
    tree = msgspec.to_builtins(message)
    values = chance.choice((HOSTILE, EXTREME))
    for _ in range(chance.randrange(4)):
        node = tree
        while node:
            place = chance.choice(list(node) if isinstance(node, dict) else range(len(node)))
            child = node[place]
            is_leaf = not isinstance(child, dict | list)
            if isinstance(child, float) or (values is HOSTILE and (is_leaf or not child)):
                node[place] = deepcopy(chance.choice(values))
            node = None if is_leaf else child
    return json.dumps(tree).encode()


def forged(good: Mapping[str, Sequence[Message]]) -> pytest.MarkDecorator:
    """Test with `wrong` payloads on the keys of `good`, with stamps of any tick and run.

    The payloads are made from the messages of `good`; some are extreme but right. Runs in the later
    half of their numbers never come.
    """

    def puts(seed: int) -> list[Put]:
        chance = random.Random(seed)

        def put() -> Put:
            key = chance.choice(sorted(good))
            message = chance.choice(good[key])
            payloads = damaged(chance, encode(message)), changed(chance, message)
            labels = "", "", JSON_ENCODING, CDR_ENCODING, "text/plain", "\x00"
            runs = chance.randrange(4), chance.randrange(2**31)
            times = chance.choice(TIMES), chance.randrange(10**10)
            stamp = chance.choice(times), chance.choice(runs), chance.randrange(2**32)
            attachments = None, chance.randbytes(chance.randrange(16)), struct.pack("<qII", *stamp)
            choices = (payloads, labels, attachments)
            return Put(key, *(chance.choice(choice) for choice in choices))

        return [put() for _ in range(chance.randrange(15, 40))]

    return pytest.mark.parametrize("wrong", [puts(seed) for seed in range(20)], ids=range(20))
