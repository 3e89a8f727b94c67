"""Messages survive CDR bit for bit, other libraries read it, and malformed bytes are refused."""

import random
import struct
import tracemalloc
from contextlib import suppress
from typing import Annotated, Any

import msgspec
import pytest
from drawn import KINDS, bits, drawn, plain
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap_ros2._dynamic import generate_dynamic
from mecazen import messages as m
from mecazen import wire
from mecazen.messages import Message
from mecazen.wire import RefusedError
from mecazen_ros import cdr
from mecazen_ros.types import definition

named = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)

HEADER = m.Header(m.Time(1, 2), "odom")
HEADER_BYTES = bytes.fromhex(
    "00010000"  # little-endian
    "01000000 02000000"  # the time
    "05000000 6f646f6d00"  # five bytes with the zero: odom
)


class Lists(Message):
    """Lists that no message of ours has yet."""

    ROS_TYPE = "test_msgs/msg/Lists"
    flags: tuple[bool, ...] = ()
    few: Annotated[tuple[m.UInt8, ...], msgspec.Meta(max_length=2)] = ()
    times: Annotated[tuple[m.Time, ...], msgspec.Meta(min_length=2, max_length=2)] = (m.Time(),) * 2
    id: Annotated[bytes, msgspec.Meta(min_length=3, max_length=3)] = b"abc"
    levels: tuple[Annotated[int, msgspec.Meta(ge=-3, le=3)], ...] = ()
    alone: Annotated[tuple[m.UInt8, ...], msgspec.Meta(min_length=1, max_length=1)] = (0,)


class Texts(Message):
    """Texts of a limited length and in an array."""

    ROS_TYPE = "test_msgs/msg/Texts"
    name: Annotated[str, msgspec.Meta(max_length=2)] = ""
    pair: Annotated[tuple[str, ...], msgspec.Meta(min_length=2, max_length=2)] = ("a", "bcdef")
    last: m.UInt8 = 3


def from_others(value: Any) -> Any:
    """Return what the independent decoder gives as plain values."""
    if hasattr(value, "__slots__"):
        return {name: from_others(getattr(value, name)) for name in value.__slots__}
    return [from_others(item) for item in value] if isinstance(value, list) else value


@named
@given(data=st.data())
@settings(max_examples=15)
def test_a_message_is_the_same_after_cdr_and_json_and_to_a_reader_of_its_definition(kind, data):
    message = data.draw(drawn(kind))
    payload = cdr.encode(message)
    assert plain(cdr.decode(payload, kind)) == plain(message)
    assert plain(wire.decode(wire.encode(message), kind)) == plain(message)
    independent = generate_dynamic(kind.ROS_TYPE, definition(kind))[kind.ROS_TYPE]
    assert bits(from_others(independent(payload))) == plain(message)


def test_numbers_are_aligned_to_their_size_counted_after_the_header():
    state = m.JointState(HEADER, ("a", "bcd"), (0.5,), (), (-2.0, 1.0))
    assert cdr.encode(state) == HEADER_BYTES + bytes.fromhex(
        "000000"  # offset 17: a length is at a multiple of 4
        "02000000 02000000 6100"  # two names, of two bytes: a
        "0000 04000000 62636400"  # and of four: bcd
        "01000000 00000000 000000000000e03f"  # offset 44: a number is at a multiple of 8
        "00000000"  # no velocity
        "02000000 00000000000000c0 000000000000f03f"  # offset 64
    )


def test_a_message_without_fields_is_one_byte():
    assert cdr.encode(m.Empty()) == b"\x00\x01\x00\x00\x00"
    assert cdr.decode(b"\x00\x01\x00\x00\x00", m.Empty) == m.Empty()


def test_arrays_and_bounded_lists_are_as_ros_has_them():
    message = Lists((True, False), (7,), (m.Time(1, 2), m.Time(3, 4)), b"xyz", (-3, 3), (9,))
    payload = b"\x00\x01\x00\x00" + struct.pack(
        "<I2B2xIB3xiIiI3sxI2bB", 2, 1, 0, 1, 7, 1, 2, 3, 4, b"xyz", 2, -3, 3, 9
    )
    assert cdr.encode(message) == payload
    assert cdr.decode(payload, Lists) == message
    wrong = bytearray(payload)
    wrong[-2] = 4  # where 3 is allowed
    with pytest.raises(RefusedError):
        cdr.decode(bytes(wrong), Lists)


def test_texts_in_an_array_begin_at_multiples_of_4():
    payload = cdr.HEADER + struct.pack("<I1s3xI2s2xI6sB", 1, b"", 2, b"a", 6, b"bcdef", 3)
    assert cdr.encode(Texts()) == payload
    assert cdr.decode(payload, Texts) == Texts()


@pytest.mark.parametrize("header", ["", "000100", "00020000", "01000000", "00030000", "7b7d2020"])
def test_another_header_is_refused(header):
    payload = bytes.fromhex(header)
    with pytest.raises(RefusedError, match="geometry_msgs/msg/Twist: Invalid or unsupp"):
        cdr.decode(payload + bytes(48) * (len(payload) == 4), m.Twist)


@named
@given(data=st.data())
@settings(max_examples=5)
def test_what_is_cut_off_is_refused_and_what_is_damaged_refused_or_of_the_type(kind, data):
    payload = cdr.encode(data.draw(drawn(kind)))
    for length in range(len(payload)):
        with pytest.raises(RefusedError):
            cdr.decode(payload[:length], kind)
    rng = random.Random(data.draw(st.integers(0)))
    for _ in range(50):
        begin = rng.randrange(len(payload))
        odd = rng.choice([b"\xff" * 4, b"\x00" * 8, b"\xf0\x7f", rng.randbytes(3)])
        damaged = payload[:begin] + odd + payload[begin + rng.choice([0, len(odd)]) :]
        with suppress(RefusedError):
            read = cdr.decode(damaged, kind)
            assert msgspec.convert(msgspec.to_builtins(read, builtin_types=(bytes,)), kind) == read


@pytest.mark.parametrize("length", [2**20, 2**31, 2**32 - 1])
@pytest.mark.parametrize("field", ["text", "texts", "numbers", "messages", "bytes"])
def test_a_length_beyond_the_payload_is_refused_without_memory_for_it(field, length):
    kind, before = {
        "text": (m.String, b""),
        "texts": (m.JointState, HEADER_BYTES[4:] + bytes(3)),
        "numbers": (m.JointState, HEADER_BYTES[4:] + bytes(7)),
        "messages": (m.DiagnosticArray, HEADER_BYTES[4:] + bytes(3)),
        "bytes": (m.Image, bytes(12) + b"\x01" + bytes(28)),
    }[field]
    payload = cdr.HEADER + before + struct.pack("<I", length) + b"\x01" * 100
    tracemalloc.start()
    try:
        with pytest.raises(RefusedError):
            cdr.decode(payload, kind)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20  # generating the function included
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1.7976931348623157e308"])
def test_numbers_that_are_not_finite_are_refused_with_their_field(number):
    payload = cdr.HEADER + struct.pack("<3d", 1.0, float(number), 2.0)
    with pytest.raises(RefusedError, match=r"geometry_msgs/msg/Vector3: .*\$\.y"):
        cdr.decode(payload, m.Vector3)
    # a list beside an opposite one, whose sum would be finite
    with pytest.raises(RefusedError, match=r"\$\.d"):
        cdr.decode(cdr.encode(m.CameraInfo(d=(float(number), -float(number)))), m.CameraInfo)


@pytest.mark.parametrize(
    ("message", "kind"),
    [
        (m.Time(0, 10**9), m.Time),
        (m.DiagnosticStatus(level=4), m.DiagnosticStatus),
        (Texts(name="abc"), Texts),
    ],
)
def test_bounds_are_those_of_the_message(message, kind):
    with pytest.raises(RefusedError, match=kind.ROS_TYPE):
        cdr.decode(cdr.encode(message), kind)


@pytest.mark.parametrize(
    "message",
    [
        m.Time(2**31),
        m.SimState(seed=-1),
        m.CameraInfo(k=(1.0,)),
        m.String("\ud800"),
    ],
)
def test_what_does_not_fit_is_not_written(message):
    with pytest.raises(RefusedError, match=f"no {message.ROS_TYPE} in CDR"):
        cdr.encode(message)


def test_lists_of_other_lengths_are_laid_out_again():
    for names in (("a", "bc"), ("a", "bd"), ("a",), (), ("a", "bc", "d")):
        state = m.JointState(name=names, position=(1.0,) * len(names))
        assert cdr.decode(cdr.encode(state), m.JointState) == state
