"""Messages and keys: fields of ROS, the same bits after the wire, and each key once."""

import math

import msgspec
import pytest
from drawn import KINDS, drawn, plain
from hypothesis import given
from hypothesis import strategies as st
from mecazen import keys, messages
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, wrap
from mecazen.messages import diagonal_covariance, planar_covariance, ros_covariance
from mecazen.wire import decode, encode
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


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_a_time_is_exact_to_the_nanosecond(time_ns):
    assert messages.Time.from_ns(time_ns).ns == time_ns


@given(st.floats(-math.pi, math.pi), finite, finite)
def test_a_planar_pose_round_trips(yaw, x, y):
    message = messages.Pose.planar(Pose2D(x, y, yaw))
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
    orientation = messages.Quaternion(
        x=length * (sr * cp * cy - cr * sp * sy),
        y=length * (cr * sp * cy + sr * cp * sy),
        z=length * (cr * cp * sy - sr * sp * cy),
        w=length * (cr * cp * cy + sr * sp * sy),
    )
    # at a pitch of 1.5 the yaw is read from numbers of cos(1.5) = 0.07: 15 times the rounding
    planar = messages.Pose(orientation=orientation).to_planar()
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


def test_every_topic_and_call_is_in_the_table_once():
    names = [topic.key for topic in keys.TOPICS] + [call.key for call in keys.CALLS]
    assert len(set(names)) == len(names)
    for topic in keys.TOPICS:
        assert keys.resolve(f"two/{topic.key}", keys.TOPICS) == ("two", topic)
    assert keys.topic_of(keys.diagnostics("physics").key) is keys.DIAGNOSTICS
    assert keys.topic_of("diagnostics") is None
    assert keys.topic_of("cmd_vel/more") is None
