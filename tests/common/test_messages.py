"""Messages, keys and the wire: bytes become the message of their key, or are refused."""

import math
import struct
import subprocess
import sys

import msgspec
import pytest
from drawn import KINDS, drawn, plain
from harness import error_of, forward
from hypothesis import given
from hypothesis import strategies as st
from mecazen import messages as m
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, wrap
from mecazen.messages import diagonal_covariance, planar_covariance, ros_covariance
from mecazen.wire import JSON_ENCODING, Stamp, decode, encode
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

finite = st.floats(-1.797e308, 1.797e308)


def test_fields_are_those_of_ros_in_their_order():
    definitions = get_typestore(Stores.ROS2_JAZZY).fielddefs
    for kind in KINDS:
        assert kind.ROS_TYPE.rpartition("/")[2] == kind.__name__
        if not kind.ROS_TYPE.startswith("mecazen_msgs/"):
            fields = [field for field in definitions[kind.ROS_TYPE][1] if kind.__struct_fields__]
            assert list(kind.__struct_fields__) == [name for name, _ in fields]
            for field, (name, (node, nested)) in zip(
                msgspec.structs.fields(kind), fields, strict=True
            ):
                if node == Nodetype.NAME:
                    assert nested == field.type.ROS_TYPE, (kind, name)


@given(st.data())
def test_messages_have_the_same_bits_after_the_wire(data):
    message = data.draw(st.sampled_from(KINDS).flatmap(drawn))
    assert plain(decode(encode(message), type(message))) == plain(message)


@given(st.floats(-math.pi, math.pi), finite, finite)
def test_a_planar_pose_round_trips(yaw, x, y):
    message = m.Pose.planar(Pose2D(x, y, yaw))
    assert (message.position.z, message.orientation.x, message.orientation.y) == (0.0, 0.0, 0.0)
    pose = message.to_planar()
    assert (pose.x, pose.y) == (x, y)
    # a sine, a cosine and an arctangent, each rounded: a few times 2⁻⁵²
    assert abs(wrap(pose.yaw - yaw)) < 4e-15


@given(
    yaw=st.floats(-3.1, 3.1),
    pitch=st.floats(-1.5, 1.5),
    roll=st.floats(-1.5, 1.5),
    length=st.sampled_from([1.0, 1e-3, 1e200]),
)
def test_the_yaw_of_a_tilted_quaternion_of_any_length(yaw, pitch, roll, length):
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    orientation = m.Quaternion(
        x=length * (sr * cp * cy - cr * sp * sy),
        y=length * (cr * sp * cy + sr * cp * sy),
        z=length * (cr * cp * sy - sr * sp * cy),
        w=length * (cr * cp * cy + sr * sp * sy),
    )
    # at a pitch of 1.5 the yaw is read from numbers of cos(1.5) = 0.07: 15 times the rounding
    planar = m.Pose(orientation=orientation).to_planar()
    assert abs(wrap(planar.yaw - yaw)) < 1e-13


def test_covariances_are_row_major():
    covariance = diagonal_covariance((1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    assert {n: value for n, value in enumerate(covariance) if value} == {
        0: 1.0, 7: 2.0, 14: 3.0, 21: 4.0, 28: 5.0, 35: 6.0
    }  # fmt: skip
    entries = tuple(float(number) for number in range(36))
    planar = ((0.0, 1.0, 5.0), (6.0, 7.0, 11.0), (30.0, 31.0, 35.0))
    assert planar_covariance(entries) == planar
    assert planar_covariance(ros_covariance(planar)) == planar
    assert sum(ros_covariance(planar)) == sum(map(sum, planar))
    with pytest.raises(RefusedError, match="36 numbers, not 9"):
        planar_covariance((0.0,) * 9)


FORWARD = forward(0.2)


def cdr(*parts, order="<"):
    """Return CDR of either byte order, of doubles and of bytes."""
    body = b"".join(p if isinstance(p, bytes) else struct.pack(f"{order}d", p) for p in parts)
    return bytes((0, order == "<", 0, 0)) + body


HEADER = struct.pack("<iII10s2x", 7, 8, 10, b"base_link\0")
"""Time, length of the frame, the frame, and padding to a multiple of 8 bytes."""


# Twists as other programs send them: each is 0.2 m/s forward.
@pytest.mark.parametrize(
    ("payload", "encoding"),
    [
        (b'{"linear":{"x":0.2}}\r\n', "zenoh/bytes"),
        (b' \t\r\n{"linear": {"x": 2e-1}}', f"{JSON_ENCODING};charset=utf-8"),
        (b'\xef\xbb\xbf{"linear":{"x":0.2}}', "text/json"),
        (b'{"header":{"frame_id":"x"},"twist":{"linear":{"x":0.2}}}', ""),
        (cdr(0.2, *[0.0] * 5), ""),
        (cdr(0.2, *[0.0] * 5, order=">"), "application/cdr"),
        (cdr(HEADER, 0.2, *[0.0] * 5), "zenoh/bytes"),
    ],
)
def test_a_twist_of_another_program_is_decoded(payload, encoding):
    assert decode(payload, m.Twist, encoding) == FORWARD


def test_a_zero_twist_and_an_emergency_stop_are_never_refused():
    for payload in (b"{}", b'{"linear":{}}', b'{"twist":{}}'):
        assert decode(payload, m.Twist) == m.Twist()
    assert decode(b'{"mine":1}', m.Empty) == m.Empty()


def test_a_scan_may_have_null_for_numbers_that_json_lacks():
    payload = b'{"range_min":0.1,"range_max":12.0,"ranges":[null,0.5,40.0],"intensities":[null]}'
    assert decode(payload, m.LaserScan).ranges == (0.0, 0.5, 40.0)


TWIST = "not a geometry_msgs/msg/Twist: "
REFUSED = [
    (b"", m.Twist, "empty payload"),
    (b'{"linear":{"x":0.2}', m.Twist, TWIST),
    (b'{"linear":{"x":NaN}}', m.Twist, TWIST),
    (b'{"linear":{"x":' + b"9" * 5000 + b"}}", m.Twist, TWIST),
    (b'{"linear":{"x":"1"}}', m.Twist, "Expected `float`, got `str` - at `$.linear.x`"),
    (b'{"clock":{"sec":4294967296}}', m.Clock, "$.clock.sec"),
    (b'{"covariance":[0' + b",0" * 34 + b"]}", m.PoseWithCovariance, "length >= 36"),
    (b"[]", m.Twist, TWIST),
    (b'{"frame_id":"\\ud800"}', m.Header, ""),
    (b'{"x":' + b"[" * 400_000 + b"]" * 400_000 + b"}", m.Twist, TWIST),
    (b'{"x":' * 100_000 + b"1" + b"}" * 100_000, m.Twist, TWIST),
    (cdr(*[0.0] * 5), m.Twist, ""),
    (cdr(bytes(4)), m.ResetRequest, ""),  # no message of ROS
    (b'{"linaer":{"x":1}}', m.Twist, f"{TWIST}Object contains unknown field `linaer`"),
    (b'{"linear":{"x":1,"q":1}}', m.Twist, "unknown field `q` - at `$.linear`"),
    (b'{"header":{},"twist":{"x":1}}', m.Twist, "unknown field `x` - at `$.twist`"),
]


@pytest.mark.parametrize(("payload", "kind", "problem"), REFUSED, ids=range(len(REFUSED)))
def test_anything_else_is_refused_in_one_line(payload, kind, problem):
    assert problem in error_of(RefusedError, lambda: decode(payload, kind))


def test_a_bus_imports_nothing_of_ros():
    code = "import sys, mecazen.bus.zenoh_bus, mecazen.runtime.process; print(*sys.modules)"
    names = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert "mecazen.bus.session" in names
    assert not [name for name in names if name.startswith(("mecazen_ros", "rosbags", "numpy"))]


@given(st.integers(0, 2**31 * 10**9 - 1), *[st.integers(0, 2**32 - 1)] * 2)
def test_a_stamp_round_trips(time_ns, run, seed):
    stamp = Stamp(time_ns, run, seed)
    assert Stamp.unpack(stamp.pack()) == stamp
    assert stamp.time.ns == time_ns


def test_an_attachment_that_is_no_stamp_is_refused():
    assert Stamp(1, 2, 3).pack() == bytes([1, *[0] * 7, 2, 0, 0, 0, 3, 0, 0, 0])  # little-endian
    for size in (0, 15, 17, 20, 999):
        assert f"{size} bytes" in error_of(
            RefusedError, lambda size=size: Stamp.unpack(bytes(size))
        )
    for time_ns in (-1, 2**31 * 10**9, 2**63 - 1):
        data = struct.pack("<qII", time_ns, 0, 0)
        assert f"time {time_ns}" in error_of(RefusedError, lambda data=data: Stamp.unpack(data))


names = st.sampled_from(
    sorted({name for kind in KINDS for name in kind.__struct_fields__} | {"x", "sec", "stamp"})
)
scalars = st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats()
values = st.recursive(
    scalars | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(names, inner, max_size=5),
    max_leaves=15,
)
tables = st.dictionaries(names, values, max_size=5).map(msgspec.json.encode)
encodings = st.sampled_from(["", "zenoh/bytes", JSON_ENCODING, "application/cdr", "\ud800", ";"])


@given(
    st.binary(max_size=200) | tables,
    st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 4), st.binary(max_size=4)), max_size=6),
    st.sampled_from(KINDS),
    encodings,
)
def test_any_bytes_are_refused_or_a_message_that_round_trips(payload, edits, kind, encoding):
    for place, cut, put in edits:
        at = place % (len(payload) + 1)
        payload = payload[:at] + put + payload[at + cut :]
    try:
        message = decode(payload, kind, encoding)
    except RefusedError:
        return
    assert isinstance(message, kind)
    assert decode(encode(message), kind) == message


@pytest.mark.parametrize(
    ("kind", "make"),
    [
        (m.Odometry, lambda x: m.Odometry(pose=m.PoseWithCovariance(m.Pose(m.Point(x))))),
        (m.Twist, lambda x: m.Twist(angular=m.Vector3(z=x))),
        (m.JointState, lambda x: m.JointState(velocity=(x,))),
        (m.Skeleton, lambda x: m.Skeleton(std=(x,))),
    ],
)
def test_a_number_at_its_limit_is_taken_and_the_next_larger_refused(kind, make):
    assert decode(encode(make(-m.FARTHEST)), kind) == make(-m.FARTHEST)
    payload = encode(make(math.nextafter(m.FARTHEST, math.inf)))
    assert "`float` <= 10000000.0" in error_of(RefusedError, lambda: decode(payload, kind))
