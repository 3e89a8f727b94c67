"""Messages in ROS 2's CDR (XCDR1): a header of four bytes, then fields aligned to their size.

Both directions are functions that are generated once a type from its fields. They pack and unpack
all between two lists of messages or of texts at once, in layouts that are cached by the lengths in
them. What they write is little-endian; they read both byte orders.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import msgspec

from mecazen.errors import RefusedError
from mecazen.messages import Message, MessageT
from mecazen.ros.decoder import MAX_PADDING, Decoder
from mecazen.ros.encoder import Encoder
from mecazen.ros.fields import RosTypeError
from mecazen.ros.layouts import HEADER as HEADER  # noqa: PLC0414  # cdr is what others import

_ORDERS = {
    bytes((0, number, 0, padding)): order
    for number, order in enumerate("><")
    for padding in range(MAX_PADDING + 1)
}
"""The byte order of each header that is read; its last byte counts padding at the end."""


def encode(message: Message) -> bytes:
    """Return a message in CDR. As in JSON, nothing is checked that has to be a message's anyway.

    Raises:
        RefusedError: A number does not fit into its type, or a text has no UTF-8.
        RosTypeError: ROS has no type for a field.
    """
    kind = type(message)
    try:
        return _encoder(kind)(message)
    except (struct.error, OverflowError, UnicodeEncodeError) as error:
        raise RefusedError(f"no {kind.ROS_TYPE} in CDR: {error}") from None


def decode(payload: bytes, kind: type[MessageT], *, finite: bool = True) -> MessageT:
    """Return the message in `payload`.

    Args:
        payload: The bytes as they came.
        kind: The type of the message.
        finite: Whether to refuse NaN and infinity, as in JSON; REP-117 has them in scans.

    Raises:
        RefusedError: Truncated, too long, of another encoding, or a value out of its bounds; or
            ROS has no type for a field of such a message.
    """
    try:
        message: MessageT = _decoders(kind, finite)[payload[:4]](payload)
    except (struct.error, IndexError, ValueError, msgspec.ValidationError, RosTypeError) as error:
        raise RefusedError(f"not a {kind.ROS_TYPE}: {error}") from None
    return message


@cache
def _encoder(kind: type[Message]) -> Callable[[Any], bytes]:
    return Encoder(kind).function


class _Decoders(dict[bytes, Callable[[bytes], Any]]):
    """The functions that decode a type, by the header; each is made when it is first needed."""

    def __init__(self, kind: type[Message], finite: bool) -> None:
        super().__init__()
        self._kind, self._finite = kind, finite

    def __missing__(self, header: bytes) -> Callable[[bytes], Any]:
        if header not in _ORDERS:
            raise ValueError("no header of CDR")
        self[header] = Decoder(self._kind, _ORDERS[header], self._finite).function
        return self[header]


_decoders = cache(_Decoders)
