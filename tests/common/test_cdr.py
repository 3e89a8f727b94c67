"""Every message survives CDR bit for bit, others read it as ROS's, and what is none is refused."""

import math
import random
import struct
import tracemalloc
from contextlib import suppress
from typing import Annotated, Any

import msgspec
import pytest
from drawn import KINDS, bits, drawn, plain
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap_ros2._dynamic import generate_dynamic
from mecazen import messages as m
from mecazen import wire
from mecazen.messages import Message
from mecazen.ros import cdr
from mecazen.ros.types import definition
from mecazen.wire import RefusedError

named = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)

HEADER = m.Header(m.Time(1, 2), "odom")
HEADER_BYTES = bytes.fromhex(
    "00010000"  # little-endian
    "01000000 02000000"  # the time
    "05000000 6f646f6d00"  # five bytes with the zero: odom
)


class Lists(Message):
    """What no message of ours has yet."""

    ROS_TYPE = "test_msgs/msg/Lists"
    flags: tuple[bool, ...] = ()
    few: Annotated[tuple[m.UInt8, ...], msgspec.Meta(max_length=2)] = ()
    times: Annotated[tuple[m.Time, ...], msgspec.Meta(min_length=2, max_length=2)] = (m.Time(),) * 2
    id: Annotated[bytes, msgspec.Meta(min_length=3, max_length=3)] = b"abc"
    levels: tuple[Annotated[int, msgspec.Meta(ge=-3, le=3)], ...] = ()
    alone: Annotated[tuple[m.UInt8, ...], msgspec.Meta(min_length=1, max_length=1)] = (0,)


class Bounded(Message):
    """Bounds on one side, or that a value must not reach."""

    ROS_TYPE = "test_msgs/msg/Bounded"
    positive: Annotated[float, msgspec.Meta(gt=0)] = 1.0
    below: Annotated[float, msgspec.Meta(lt=1.0)] = 0.0
    least: Annotated[int, msgspec.Meta(ge=1)] = 1
    shares: tuple[Annotated[float, msgspec.Meta(ge=0, le=1)], ...] = ()
    name: Annotated[str, msgspec.Meta(max_length=2)] = ""


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
    assert plain(wire.decode(wire.encode(message, "json"), kind)) == plain(message)
    independent = generate_dynamic(kind.ROS_TYPE, definition(kind))[kind.ROS_TYPE]
    assert bits(from_others(independent(payload))) == plain(message)


def test_a_header_is_these_bytes():
    assert cdr.encode(HEADER) == HEADER_BYTES


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


def test_big_endian_is_read():
    payload = bytes(4) + struct.pack(">iII5s3xIdd", 1, 2, 5, b"odom", 2, 3.0, 4.0)

    class Numbers(Message):
        ROS_TYPE = "test_msgs/msg/Numbers"
        header: m.Header = m.Header()
        numbers: m.Floats = ()

    # struct pads nothing here: offset 24 after the count
    assert cdr.decode(payload, Numbers) == Numbers(HEADER, (3.0, 4.0))


def test_arrays_and_bounded_lists_are_as_ros_has_them():
    message = Lists((True, False), (7,), (m.Time(1, 2), m.Time(3, 4)), b"xyz", (-3, 3), (9,))
    payload = b"\x00\x01\x00\x00" + struct.pack(
        "<I2B2xIB3xiIiI3sxI2bB", 2, 1, 0, 1, 7, 1, 2, 3, 4, b"xyz", 2, -3, 3, 9
    )
    assert cdr.encode(message) == payload
    assert cdr.decode(payload, Lists) == message
    for place, value in ((12, 3), (-2, 4)):  # three where two are allowed; 4 where 3 is
        wrong = bytearray(payload)
        wrong[place] = value
        with pytest.raises(RefusedError):
            cdr.decode(bytes(wrong), Lists)


@pytest.mark.parametrize("padding", [0, 1, 2, 3])
def test_padding_to_a_multiple_of_4_may_follow_and_nothing_else(padding):
    payload = bytes((0, 1, 0, padding)) + HEADER_BYTES[4:] + bytes(padding)
    assert cdr.decode(payload, m.Header) == HEADER
    with pytest.raises(RefusedError, match="more than the message has"):
        cdr.decode(payload + bytes(4 - padding), m.Header)
    with pytest.raises(RefusedError, match="more than the message has"):
        cdr.decode(payload[:21] + b"\x01", m.Header)


@pytest.mark.parametrize(
    "header", ["", "000100", "00020000", "01000000", "00030000", "00010100", "000100ff", "7b7d2020"]
)
def test_another_header_is_refused(header):
    payload = bytes.fromhex(header)
    with pytest.raises(RefusedError, match="geometry_msgs/msg/Twist: no header of CDR"):
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


@given(st.binary(max_size=200), st.sampled_from(KINDS))
@settings(max_examples=300)
@example(b"", m.Empty)
def test_any_bytes_are_refused_or_a_message(payload, kind):
    with suppress(RefusedError):
        assert isinstance(cdr.decode(cdr.HEADER + payload, kind), kind)


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


@pytest.mark.parametrize("text", [b"\x02\x00\x00\x00\xff\x00", b"\x02\x00\x00\x00aa"])
def test_a_text_without_utf_8_or_without_its_end_is_refused(text):
    with pytest.raises(RefusedError):
        cdr.decode(cdr.HEADER + text, m.String)


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1.7976931348623157e308"])
def test_numbers_that_are_not_finite_are_refused_with_their_field(number):
    payload = cdr.HEADER + struct.pack("<3d", 1.0, float(number), 2.0)
    with pytest.raises(RefusedError, match=r"geometry_msgs/msg/Vector3: .*\$\.y"):
        cdr.decode(payload, m.Vector3)
    # a list beside an opposite one, whose sum would be finite
    with pytest.raises(RefusedError, match=r"\$\.d"):
        cdr.decode(cdr.encode(m.CameraInfo(d=(float(number), -float(number)))), m.CameraInfo)


def test_infinities_of_a_scan_are_read_where_they_are_wanted():
    scan = m.LaserScan(ranges=(1.0, float("inf"), float("-inf")))
    payload = cdr.encode(scan)
    assert cdr.decode(payload, m.LaserScan, finite=False) == scan
    with pytest.raises(RefusedError, match=r"\$\.ranges"):
        cdr.decode(payload, m.LaserScan)


def test_large_numbers_are_numbers():
    vector = m.Vector3(1.7e308, 1.7e308, -1.7e308)
    assert cdr.decode(cdr.encode(vector), m.Vector3) == vector


@pytest.mark.parametrize(
    ("message", "kind"),
    [
        (m.Time(0, 10**9), m.Time),
        (m.DiagnosticStatus(level=4), m.DiagnosticStatus),
        (m.StepRequest(ticks=0), m.StepRequest),
        (m.SpeedRequest(speed=0.0), m.SpeedRequest),
        (Bounded(positive=0.0), Bounded),
        (Bounded(below=1.0), Bounded),
        (Bounded(least=0), Bounded),
        (Bounded(shares=(0.0, 1.5)), Bounded),
        (Bounded(name="abc"), Bounded),
    ],
)
def test_bounds_are_those_of_the_message(message, kind):
    with pytest.raises(RefusedError, match=kind.ROS_TYPE):
        cdr.decode(cdr.encode(message), kind)


@pytest.mark.parametrize(
    "message", [m.Time(2**31), m.SimState(seed=-1), m.LaserScan(angle_min=1e39)]
)
def test_what_does_not_fit_is_not_written(message):
    with pytest.raises(RefusedError, match=f"no {message.ROS_TYPE} in CDR"):
        cdr.encode(message)


@pytest.mark.parametrize(
    "message",
    [
        Bounded(),
        Bounded(positive=5e-324, below=math.nextafter(1.0, 0.0), least=2**63 - 1),
        Bounded(positive=1.7e308, below=-1.7e308, shares=(0.0, 1.0), name="ab"),
    ],
)
def test_whatever_is_within_its_bounds_is_taken(message):
    assert cdr.decode(cdr.encode(message), Bounded) == message


def test_names_that_change_are_read_anew():
    for names in (("a", "bc"), ("a", "bc"), ("a", "bd"), ("a",), (), ("a", "bc", "d")):
        state = m.JointState(name=names, position=(1.0,))
        assert cdr.decode(cdr.encode(state), m.JointState) == state
