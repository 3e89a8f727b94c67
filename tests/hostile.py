"""Payloads that are wrong, or extreme but right, for every service."""

import json
import struct
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from typing import Any, NamedTuple

import msgspec
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from mecazen.messages import Message
from mecazen.wire import CDR_ENCODING, JSON_ENCODING, encode


class Put(NamedTuple):
    """A sample that an external program puts on a key."""

    key: str
    payload: bytes
    encoding: str
    attachment: bytes | None


_EXTREME = [1e-320, -0.0, 10.0, 1e5, 1e6, -1e7, 1e155, 1e200, 1e308, -1e308, 1.797e308, -1.797e308]
_HOSTILE: list[Any] = [None, True, "", "1", [], {}, [[]], [0.0] * 36, [1e308] * 36, [-1.0] * 36]
_HOSTILE += [0, -1, 2**31, 2**32, -(2**31), 2**63, -(2**63), 10**30, *_EXTREME]
_HOSTILE += [float("nan"), float("inf"), float("-inf"), "\ud7ff", "é" * 50, list(range(200))]


@st.composite
def _payload(draw: st.DrawFn, messages: Sequence[Message]) -> bytes:
    """Random bytes, or a good message with bytes or values damaged, or numbers extreme."""
    message = draw(st.sampled_from(messages))
    kind = draw(st.integers(0, 7))
    if kind == 0:
        return draw(st.binary(max_size=60))
    if kind == 1:
        payload = bytearray(encode(message))
        for _ in range(draw(st.integers(1, 3))):
            begin = draw(st.integers(0, len(payload)))
            end = begin + draw(st.sampled_from([0, 1, 3, len(payload)]))
            payload[begin:end] = draw(st.binary(max_size=3))
        return bytes(payload)
    tree = msgspec.to_builtins(message)
    for _ in range(draw(st.integers(0, 3))):
        _damage(draw, tree, extreme=kind < 5)
    return json.dumps(tree).encode()


def _damage(draw: st.DrawFn, node: Any, *, extreme: bool) -> None:
    """Put a hostile value in a random place of a tree of dicts and lists.

    Where it is to be `extreme`, it is a number in a number's place, so that the message stays
    one that its key carries.
    """
    while node:
        places = list(node) if isinstance(node, dict) else list(range(len(node)))
        place = draw(st.sampled_from(places))
        child = node[place]
        leaf = not isinstance(child, dict | list) or not child
        if extreme and leaf:
            if isinstance(child, float):
                node[place] = draw(st.sampled_from(_EXTREME))
            return
        if leaf or (not extreme and draw(st.integers(0, 5)) == 0):
            node[place] = deepcopy(draw(st.sampled_from(_HOSTILE)))
            return
        node = child


_TIMES = st.sampled_from([0, 10_000_000, 2**31 * 10**9 - 1, 2**31 * 10**9, 2**63 - 1, -1])
_RUNS = st.integers(0, 3) | st.integers(0, 2**31)
ATTACHMENTS = (
    st.none()
    | st.binary(max_size=24).filter(lambda data: len(data) not in (16, 20))
    | st.builds(
        lambda *stamp: struct.pack("<qII", *stamp),
        _TIMES | st.integers(0, 10**10) | st.integers(-(2**63), 2**63 - 1),
        _RUNS,
        st.integers(0, 2**32 - 1),
    )
)
"""No stamps, and stamps of any tick of any run, of which the later half is never used."""


def forged(good: Mapping[str, Sequence[Message]], max_examples: int = 20) -> Callable[[Any], Any]:
    """Test with `wrong` payloads on the keys of `good`, with stamps of any tick and run.

    The payloads are made from the messages of `good`; some are extreme but right. An example has up
    to 40 of them.
    """
    put = st.sampled_from(sorted(good)).flatmap(
        lambda key: st.builds(
            Put,
            st.just(key),
            _payload(good[key]),
            st.sampled_from(["", "", JSON_ENCODING, CDR_ENCODING, "text/plain", "\x00"]),
            ATTACHMENTS,
        )
    )
    fuzz = settings(
        max_examples=max_examples,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.generate],  # with Phase.shrink a failure is shorter, and comes minutes later
    )
    return lambda test: fuzz(given(wrong=st.lists(put, min_size=15, max_size=40))(test))
