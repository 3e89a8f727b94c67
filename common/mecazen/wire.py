"""Encoding and decoding: messages as JSON, and the stamp attached to samples.

With the extra `ros2`, ROS 2's CDR is decoded as well.
"""

from __future__ import annotations

import struct
from codecs import BOM_UTF8
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any, NamedTuple, cast

import msgspec

from mecazen.errors import RefusedError as RefusedError  # noqa: PLC0414  # wire raises it
from mecazen.errors import is_installed
from mecazen.messages import (
    LaserScan,
    Message,
    MessageT,
    Time,
    Twist,
    TwistStamped,
    finite_scan,
)

NS_PER_S = 10**9
MAX_SAMPLE_BYTES = 1 << 16
"""Size limit of samples, unless their topic has another [bytes]: ten times `joint_states` with
every roller."""
MAX_PAYLOAD_BYTES = 6 << 20
"""Largest size limit of a topic [bytes]: a picture of 1920 x 1080 pixels of 16 bits in JSON's
base64 has 5.3 MiB."""
MAX_TIME_NS = 2**31 * 10**9 - 1
"""The latest time that a message's `Time` can represent [ns]."""
JSON_ENCODING = "application/json"
CDR_ENCODING = "application/cdr"

_STAMP = struct.Struct("<qII")
_ENCODER = msgspec.json.Encoder()


class Stamp(NamedTuple):
    """The tick that a sample belongs to: simulated time, the run, and the run's seed.

    A run begins when physics starts or is reset. Its number distinguishes samples of this run from
    samples that were still on their way at a reset.
    """

    time_ns: int
    run: int
    seed: int

    @property
    def time(self) -> Time:
        """The simulated time as a message."""
        return Time.from_ns(self.time_ns)

    def pack(self) -> bytes:
        """Return the stamp as a Zenoh attachment: int64 ns, uint32, uint32.

        >>> Stamp(10_000_000, run=1, seed=2).pack().hex(" ", 4)
        '80969800 00000000 01000000 02000000'
        """
        return _STAMP.pack(*self)

    @classmethod
    def unpack(cls, attachment: bytes) -> Stamp:
        """Return the stamp of an attachment.

        Raises:
            RefusedError: The length is wrong, or `Time` can't represent the time.
        """
        if len(attachment) != _STAMP.size:
            raise RefusedError(f"attachment of {len(attachment)} bytes, a stamp has {_STAMP.size}")
        stamp = cls(*_STAMP.unpack(attachment))
        if not 0 <= stamp.time_ns <= MAX_TIME_NS:
            raise RefusedError(f"attachment with the time {stamp.time_ns} ns")
        return stamp


def encode(message: Message) -> bytes:
    """Return `message` as JSON.

    >>> encode(Time(sec=1, nanosec=500))
    b'{"sec":1,"nanosec":500}'
    """
    return _ENCODER.encode(message)


@cache
def _decoder(kind: Any) -> Callable[[bytes], Any]:
    return msgspec.json.Decoder(kind).decode


def decode(payload: bytes, kind: type[MessageT], encoding: str = "") -> MessageT:
    """Return the message in `payload`.

    Args:
        payload: The bytes as received.
        kind: The type of message that the key carries.
        encoding: Zenoh's encoding.

    >>> decode(b'{"sec": 1}', Time)
    Time(sec=1, nanosec=0)

    Raises:
        RefusedError: The payload is empty, truncated or of a wrong type, has an unknown field, or
            a number is not finite.
    """
    if not payload:
        raise RefusedError("empty payload")
    try:
        if is_cdr(payload, encoding):
            return cast(MessageT, _cdr_decoder()(payload, kind))
        return cast(MessageT, _decoded(payload.removeprefix(BOM_UTF8), kind))
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        problem = str(error)
        if "unknown field" in problem and " - at " not in problem:  # a field of the message itself
            problem += f"; allowed: {', '.join(kind.__struct_fields__)}"
        raise RefusedError(f"not a {kind.ROS_TYPE}: {problem}") from None


def _decoded(payload: bytes, kind: type[Message]) -> Message:
    try:
        return cast(Message, _decoder(kind)(payload))
    except msgspec.ValidationError:
        if kind is Twist and b'"twist"' in payload:
            stamped: TwistStamped = _decoder(TwistStamped)(payload)
            return stamped.twist
        if kind is not LaserScan:
            raise
        scan = _decoder(dict[str, Any])(payload)
        return msgspec.convert(finite_scan(scan), LaserScan)


@cache
def _cdr_decoder() -> Callable[[bytes, type[Message]], Any]:
    if not is_installed("ros2"):
        raise RefusedError(f"{CDR_ENCODING} needs pip install 'mecazen[ros2]'")
    return cast(Callable[[bytes, type[Message]], Any], import_module("mecazen_ros.cdr").decode)


def is_cdr(payload: bytes, encoding: str) -> bool:
    """Return whether a payload is CDR by its encoding or its header, with which no JSON begins."""
    return encoding.partition(";")[0] == CDR_ENCODING or payload[:2] in (b"\0\0", b"\0\1")
