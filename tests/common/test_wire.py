"""Bytes become the message that their key carries, or are refused; nothing else happens."""

import struct
import subprocess
import sys

import msgspec
import pytest
from harness import error_of
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mecazen import keys, wire
from mecazen import messages as m
from mecazen.wire import (
    JSON_ENCODING,
    MAX_PAYLOAD_BYTES,
    RefusedError,
    Stamp,
    decode,
    encode,
)

FORWARD = m.Twist(linear=m.Vector3(x=0.2))
KINDS = sorted(
    {topic.type for topic in keys.TOPICS}
    | {call.request for call in keys.CALLS}
    | {call.answer for call in keys.CALLS},
    key=lambda kind: kind.__name__,
)


@pytest.mark.parametrize(
    "payload",
    [
        b'{"linear":{"x":0.2}}',
        b'{"linear":{"x":0.2}}\n',
        b'{"linear":{"x":0.2}}\r\n',
        b' \t\r\n{"linear": {"x": 2e-1}}',
    ],
)
@pytest.mark.parametrize(
    "encoding", ["", "zenoh/bytes", "text/plain", "text/json", f"{JSON_ENCODING};charset=utf-8"]
)
def test_a_part_of_a_message_is_a_whole_message_whatever_json_is_called(payload, encoding):
    assert decode(payload, m.Twist, encoding) == FORWARD


def test_an_encoding_of_a_package_that_is_not_installed_is_refused_by_its_name(monkeypatch):
    monkeypatch.setattr(wire, "is_installed", lambda extra: False)
    wire._cdr_decoder.cache_clear()
    problem = r"application/cdr needs pip install 'mecazen\[ros2\]'"
    with pytest.raises(RefusedError, match=problem):
        decode(bytes(52), m.Twist, "application/cdr")


def test_a_bus_imports_nothing_of_ros():
    code = "import sys, mecazen.bus.zenoh_bus, mecazen.runtime.process; print(*sys.modules)"
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "mecazen.bus.session" in found
    assert not [name for name in found if name.startswith(("mecazen_ros", "rosbags", "numpy"))]


REFUSED = {
    "empty": (b"", m.Twist),
    "truncated": (b'{"linear":{"x":0.2}', m.Twist),
    "MessagePack": (b"\x81\xa6linear\x80", m.Twist),
    "half of a header of CDR": (b"\x00\x01", m.Twist),
    "null": (b"null", m.Twist),
    "NaN in JSON": (b'{"linear":{"x":NaN}}', m.Twist),
    "too large for a float": (b'{"linear":{"x":1e400}}', m.Twist),
    "too many digits for a float": (b'{"linear":{"x":' + b"9" * 5000 + b"}}", m.Twist),
    "NaN in a list": (b'{"position":[0.0,NaN]}', m.JointState),
    "a whole number over 32 bits": (b'{"clock":{"sec":4294967296}}', m.Clock),
    "a whole number of too many digits": (b'{"tick":' + b"9" * 5000 + b"}", m.SimState),
    "a second of nanoseconds": (b'{"nanosec":1000000000}', m.Time),
    "35 covariances": (b'{"covariance":[0' + b",0" * 34 + b"]}", m.PoseWithCovariance),
    "a list": (b"[]", m.Twist),
    "no UTF-8": (b'{"frame_id":"\xff"}', m.Header),
    "half of a surrogate": (b'{"frame_id":"\\ud800"}', m.Header),
    "lists in lists": (b'{"x":' + b"[" * 400_000 + b"]" * 400_000 + b"}", m.Twist),
    "tables in tables": (b'{"x":' * 100_000 + b"1" + b"}" * 100_000, m.Twist),
    "CDR, one number short": (b"\x00\x01\x00\x00" + bytes(40), m.Twist),
    "only unknown fields": (b'{"linaer":{"x":1},"angle":1}', m.Twist),
    "only unknown fields of a part": (b'{"linear":{"X":1}}', m.Twist),
    "only unknown fields of a stamped twist": (b'{"header":{},"twist":{"x":1}}', m.Twist),
    "a wrong type in a stamped twist": (b'{"twist":{"linear":{"x":"1"}}}', m.Twist),
    "an unknown field of a request": (b'{"factr":2}', m.SpeedRequest),
    "CDR of what ROS can't say": (b"\x00\x01\x00\x00" + bytes(4), m.ResetRequest),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_not_what_the_key_carries_is_refused_in_one_line(case):
    payload, kind = REFUSED[case]
    assert error_of(RefusedError, lambda: decode(payload, kind))


def cdr(*parts, order="<"):
    """Return CDR of either byte order, of doubles and of bytes."""
    body = b"".join(p if isinstance(p, bytes) else struct.pack(f"{order}d", p) for p in parts)
    return bytes((0, order == "<", 0, 0)) + body


HEADER = struct.pack("<iII10s2x", 7, 8, 10, b"base_link\0")
"""Time, length of the frame, the frame, and padding to a multiple of 8 bytes."""


# Twists as other programs send them: each is 0.2 m/s forward.
@pytest.mark.parametrize(
    ("payload", "encodings"),
    [
        (b'{"header":{"frame_id":"x"},"twist":{"linear":{"x":0.2}}}', ("", JSON_ENCODING)),
        (b'{"twist":{"linear":{"x":0.2}}}', ("", JSON_ENCODING)),
        (b'\xef\xbb\xbf{"linear":{"x":0.2}}', ("", JSON_ENCODING)),
        (cdr(0.2, 0.0, 0.0, 0.0, 0.0, 0.0), ("", "zenoh/bytes", "application/cdr")),
        (cdr(0.2, 0.0, 0.0, 0.0, 0.0, 0.0, order=">"), ("", "application/cdr")),
        (cdr(HEADER, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0), ("", "application/cdr")),
        (b'{"linear":{"x":0.2},"linaer":{}}', ("",)),  # the bus warns of the unknown field
    ],
)
def test_a_twist_of_another_program_is_not_taken_for_zero(payload, encodings):
    for encoding in encodings:
        assert decode(payload, m.Twist, encoding) == FORWARD


@pytest.mark.parametrize("payload", [b"{}", b'{"linear":{}}', b'{"linear":{"x":0.0},"mine":1}'])
def test_a_zero_twist_stops_whatever_else_it_has(payload):
    assert decode(payload, m.Twist) == m.Twist()
    assert decode(b'{"mine":1}', m.Empty) == m.Empty()  # an emergency stop is never refused


def test_a_scan_may_have_null_for_numbers_that_json_lacks():
    payload = b'{"range_min":0.1,"range_max":12.0,"ranges":[null,0.5,40.0],"intensities":[null]}'
    assert decode(payload, m.LaserScan).ranges == (0.0, 0.5, 40.0)


def test_a_payload_of_just_six_mebibytes_is_taken_and_a_byte_more_is_refused():
    assert MAX_PAYLOAD_BYTES == 6 << 20
    payload = b"{}" + b" " * (MAX_PAYLOAD_BYTES - 2)
    assert decode(payload, m.Twist) == m.Twist()
    with pytest.raises(RefusedError, match=f"{MAX_PAYLOAD_BYTES + 1} bytes"):
        decode(payload + b" ", m.Twist)


def test_a_refusal_names_the_type_and_the_field():
    with pytest.raises(RefusedError, match=r"geometry_msgs/msg/Twist: .*\$\.linear\.x"):
        decode(b'{"linear":{"x":"1"}}', m.Twist)


@given(st.integers(0, 2**31 * 10**9 - 1), *[st.integers(0, 2**32 - 1)] * 3)
def test_a_stamp_round_trips(time_ns, run, seed, revision):
    stamp = Stamp(time_ns, run, seed, revision)
    assert Stamp.unpack(stamp.pack()) == stamp
    assert stamp.time.ns == time_ns


def test_a_stamp_is_16_bytes_little_endian_and_20_with_a_revision():
    assert Stamp(1, 2, 3).pack() == bytes([1, *[0] * 7, 2, 0, 0, 0, 3, 0, 0, 0])
    assert Stamp(1, 2, 3, 4).pack() == Stamp(1, 2, 3).pack() + bytes([4, 0, 0, 0])


@pytest.mark.parametrize("size", [0, 1, 15, 17, 20, 21, 100_000])
def test_an_attachment_of_another_length_is_refused(size):
    with pytest.raises(RefusedError, match=f"{size} bytes"):
        Stamp.unpack(bytes(size))


@pytest.mark.parametrize("time_ns", [-1, -(2**63), 2**31 * 10**9, 2**63 - 1])
def test_an_attachment_whose_time_no_message_can_hold_is_refused(time_ns):
    with pytest.raises(RefusedError, match=str(time_ns)):
        Stamp.unpack(struct.pack("<qII", time_ns, 0, 0))


def decode_or_refuse(payload, kind, encoding):
    try:
        message = decode(payload, kind, encoding)
    except RefusedError:
        return
    assert isinstance(message, kind)
    # what was taken can be passed on
    assert decode(encode(message), kind) == message


kinds = st.sampled_from(KINDS)
encodings = st.sampled_from(["", "zenoh/bytes", JSON_ENCODING, "application/cdr", "\ud800", ";"])
some_names = st.sampled_from(
    sorted({name for kind in KINDS for name in kind.__struct_fields__} | {"x", "sec", "stamp"})
)
scalars = st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats()
values = st.recursive(
    scalars | st.text(max_size=5) | st.binary(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(some_names, inner, max_size=5),
    max_leaves=15,
)


@settings(max_examples=1000)
@given(st.binary(max_size=200), kinds, encodings)
def test_any_bytes_expect_a_message_or_a_refusal(payload, kind, encoding):
    decode_or_refuse(payload, kind, encoding)


@settings(max_examples=1000)
@given(st.dictionaries(some_names, values, max_size=5), kinds)
def test_any_tables_expect_a_message_or_a_refusal(table, kind):
    decode_or_refuse(msgspec.json.encode(table), kind, "")


SEEDS = [
    encode(message)
    for message in (
        m.Odometry(),
        m.Observation(poses=(m.PoseWithCovariance(),)),
        m.JointState(name=("a", "b"), position=(0.1, -1e300), effort=(0.0,)),
        m.SimState(tick=2**40, seed=7, mode="lockstep"),
    )
]


@settings(max_examples=1000)
@given(
    seed=st.sampled_from(SEEDS),
    edits=st.lists(
        st.tuples(st.integers(0, 2000), st.integers(0, 4), st.binary(max_size=4)), max_size=6
    ),
    kind=kinds,
    encoding=encodings,
)
@example(seed=SEEDS[0], edits=[(0, 2000, b"")], kind=m.Odometry, encoding=JSON_ENCODING)
def test_any_mutation_of_a_message_expect_a_message_or_a_refusal(seed, edits, kind, encoding):
    payload = seed
    for place, cut, put in edits:
        at = place % (len(payload) + 1)
        payload = payload[:at] + put + payload[at + cut :]
    decode_or_refuse(payload, kind, encoding)


@settings(max_examples=300)
@given(st.binary(max_size=40))
def test_any_attachment_expect_a_stamp_or_a_refusal(attachment):
    try:
        stamp = Stamp.unpack(attachment)
    except RefusedError:
        return
    assert stamp.pack() == attachment
