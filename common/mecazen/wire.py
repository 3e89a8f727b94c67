"""Bytes to messages and back: JSON or MessagePack, and the stamp that goes with samples.

Installed packages read further encodings: a function `decode(payload, kind)` that raises
RefusedError, under the encoding's name in the entry points of the group `mecazen.encodings`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from importlib.metadata import entry_points
from typing import Any, Literal, NamedTuple, cast

import msgspec

from mecazen.errors import RefusedError as RefusedError  # noqa: PLC0414  # wire raises it
from mecazen.messages import Message, MessageT, Time

Format = Literal["json", "msgpack"]

NS_PER_S = 10**9
MAX_PAYLOAD_BYTES = 1 << 20
MAX_SAMPLE_BYTES = 1 << 16
"""Limit of samples on topics: ten times the longest, `joint_states` with every roller."""
MAX_ENVELOPE_BYTES = 1 << 10
"""Limit of key and attachment of a sample, and of a query's parameters as well."""
MAX_MESSAGE_BYTES = 4 * MAX_PAYLOAD_BYTES
"""Limit of any message on a link, before its fragments are put together. A mesh that is served as a
file, and samples on other keys, may be longer than a payload of the table."""
MAX_TIME_NS = 2**31 * 10**9 - 1
"""The latest time that a message's `Time` can hold."""
JSON_ENCODING = "application/json"
MSGPACK_ENCODING = "application/msgpack"
PLUGGED = {"application/cdr": "mecazen-ros"}
"""Encodings that are read where a package is installed."""
ENCODINGS: dict[Format, str] = {"json": JSON_ENCODING, "msgpack": MSGPACK_ENCODING}

_STAMP = struct.Struct("<qII")
_REVISED = struct.Struct("<qIII")
_JSON = msgspec.json.Encoder()
_MSGPACK = msgspec.msgpack.Encoder()


class Stamp(NamedTuple):
    """The tick that a sample belongs to: simulated time, the run, and the run's seed.

    A run begins when physics starts or is reset, and has a number of its own, so what is
    still on its way from before a reset can be told apart.
    """

    time_ns: int
    run: int
    seed: int
    revision: int = 0
    """How often parameters have been changed until this tick; see `mecazen.parameters`."""

    @property
    def time(self) -> Time:
        """The simulated time as a message."""
        return Time.from_ns(self.time_ns)

    def pack(self) -> bytes:
        """Return the stamp as a Zenoh attachment: int64 ns, uint32, uint32.

        A uint32 follows where parameters have been changed.

        >>> Stamp(10_000_000, run=1, seed=2).pack().hex(" ", 4)
        '80969800 00000000 01000000 02000000'
        """
        if self.revision:
            return _REVISED.pack(*self)
        return _STAMP.pack(self.time_ns, self.run, self.seed)

    @classmethod
    def unpack(cls, attachment: bytes) -> Stamp:
        """Return the stamp of an attachment.

        Raises:
            RefusedError: It is not as long as a stamp is, or its time is none that `Time` can hold.
        """
        is_revised = len(attachment) == _REVISED.size and any(attachment[_STAMP.size :])
        form = _REVISED if is_revised else _STAMP
        if len(attachment) != form.size:
            raise RefusedError(f"attachment of {len(attachment)} bytes, a stamp has {_STAMP.size}")
        stamp = cls(*form.unpack(attachment))
        if not 0 <= stamp.time_ns <= MAX_TIME_NS:
            raise RefusedError(f"attachment with the time {stamp.time_ns} ns")
        return stamp


def encode(message: Message, form: Format) -> bytes:
    """Return `message` as bytes.

    >>> encode(Time(sec=1, nanosec=500), "json")
    b'{"sec":1,"nanosec":500}'
    """
    return (_JSON if form == "json" else _MSGPACK).encode(message)


@cache
def _json_decoder(kind: type[MessageT]) -> msgspec.json.Decoder[MessageT]:
    return msgspec.json.Decoder(kind)


@cache
def _msgpack_decoder(kind: type[MessageT]) -> msgspec.msgpack.Decoder[MessageT]:
    return msgspec.msgpack.Decoder(kind)


def decode(payload: bytes, kind: type[MessageT], encoding: str = "") -> MessageT:
    """Return the message in `payload`.

    Args:
        payload: The bytes as they came.
        kind: The message that the key carries.
        encoding: Zenoh's encoding; where it names no format, the first bytes tell.

    >>> decode(b'{"sec": 1}', Time)
    Time(sec=1, nanosec=0)

    Raises:
        RefusedError: Empty, oversized, truncated, of a wrong type, or with numbers not finite.
    """
    if not payload:
        raise RefusedError("empty payload")
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise RefusedError(f"payload of {len(payload)} bytes, at most {MAX_PAYLOAD_BYTES} allowed")
    try:
        form = format_of(payload, encoding)
        if form in PLUGGED:
            return cast(MessageT, _plugged(form)(payload, kind))
        if form == "json":
            return cast(MessageT, _json_decoder(kind).decode(payload))
        return cast(MessageT, _msgpack_decoder(kind).decode(payload))
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise RefusedError(f"not a {kind.ROS_TYPE}: {error}") from None


@cache
def _plugged(encoding: str) -> Callable[[bytes, type[Message]], Any]:
    for entry in entry_points(group="mecazen.encodings", name=encoding):
        return cast(Callable[[bytes, type[Message]], Any], entry.load())
    what = PLUGGED[encoding]
    raise RefusedError(f"{encoding}: {what} is not installed; `pip install {what}`")


def format_of(payload: bytes, encoding: str) -> str:
    """Return a payload's format, or its encoding if it is of `PLUGGED`.

    It follows from the encoding; if that names none, from the first bytes.

    Raises:
        RefusedError: It begins as none of them.
    """
    media = encoding.partition(";")[0]
    if media in (JSON_ENCODING, "text/json"):
        return "json"
    if media == MSGPACK_ENCODING:
        return "msgpack"
    if media in PLUGGED:
        return media
    first = payload[0]
    if first == 0x7B or first in b" \t\r\n":
        return "json"
    # the three ways in which MessagePack begins a map, which every message is
    if 0x80 <= first <= 0x8F or first in (0xDE, 0xDF):
        return "msgpack"
    raise RefusedError(f"neither JSON nor MessagePack: first byte 0x{first:02x}")
