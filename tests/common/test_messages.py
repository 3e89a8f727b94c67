"""Messages are ROS's, field for field, and come back from the wire bit for bit."""

import math
from typing import get_type_hints

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen import messages
from mecazen.covariance import diagonal_covariance
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen.wire import decode, encode

# The fields of ROS 2's .msg files, in their order, with mecazen's type for each.
ROS_FIELDS = {
    "builtin_interfaces/msg/Time": "sec nanosec",
    "std_msgs/msg/Header": "stamp:Time frame_id",
    "std_msgs/msg/String": "data",
    "std_msgs/msg/Empty": "",
    "rosgraph_msgs/msg/Clock": "clock:Time",
    "geometry_msgs/msg/Vector3": "x y z",
    "geometry_msgs/msg/Point": "x y z",
    "geometry_msgs/msg/Quaternion": "x y z w",
    "geometry_msgs/msg/Twist": "linear:Vector3 angular:Vector3",
    "geometry_msgs/msg/Pose": "position:Point orientation:Quaternion",
    "geometry_msgs/msg/PoseWithCovariance": "pose:Pose covariance",
    "geometry_msgs/msg/TwistWithCovariance": "twist:Twist covariance",
    "nav_msgs/msg/Odometry": (
        "header:Header child_frame_id pose:PoseWithCovariance twist:TwistWithCovariance"
    ),
    "sensor_msgs/msg/JointState": "header:Header name position velocity effort",
    "sensor_msgs/msg/LaserScan": (
        "header:Header angle_min angle_max angle_increment time_increment scan_time "
        "range_min range_max ranges intensities"
    ),
    "sensor_msgs/msg/Image": "header:Header height width encoding is_bigendian step data",
    "sensor_msgs/msg/RegionOfInterest": "x_offset y_offset height width do_rectify",
    "sensor_msgs/msg/CameraInfo": (
        "header:Header height width distortion_model d k r p binning_x binning_y "
        "roi:RegionOfInterest"
    ),
    "sensor_msgs/msg/Imu": (
        "header:Header orientation:Quaternion orientation_covariance "
        "angular_velocity:Vector3 angular_velocity_covariance linear_acceleration:Vector3 "
        "linear_acceleration_covariance"
    ),
    "sensor_msgs/msg/BatteryState": (
        "header:Header voltage temperature current charge capacity design_capacity "
        "percentage power_supply_status power_supply_health power_supply_technology "
        "present cell_voltage cell_temperature location serial_number"
    ),
    "diagnostic_msgs/msg/KeyValue": "key value",
    "diagnostic_msgs/msg/DiagnosticStatus": "level name message hardware_id values",
    "diagnostic_msgs/msg/DiagnosticArray": "header:Header status",
}

KINDS = [
    kind
    for kind in vars(messages).values()
    if isinstance(kind, type)
    and issubclass(kind, messages.Message)
    and kind is not messages.Message
]
ROS_KINDS = {kind.ROS_TYPE: kind for kind in KINDS if kind.ROS_TYPE in ROS_FIELDS}

finite = st.floats(-1.797e308, 1.797e308)
vectors = st.builds(messages.Vector3, finite, finite, finite)
twists = st.builds(messages.Twist, vectors, vectors)
times = st.builds(messages.Time, st.integers(-(2**31), 2**31 - 1), st.integers(0, 10**9 - 1))
headers = st.builds(messages.Header, times, st.text())
points = st.builds(messages.Point, finite, finite, finite)
quaternions = st.builds(messages.Quaternion, finite, finite, finite, finite)
covariances = st.lists(finite, min_size=36, max_size=36).map(tuple)
poses = st.builds(
    messages.PoseWithCovariance, st.builds(messages.Pose, points, quaternions), covariances
)
odometries = st.builds(
    messages.Odometry,
    headers,
    st.text(),
    poses,
    st.builds(messages.TwistWithCovariance, twists, covariances),
)
floats = st.lists(finite, max_size=40).map(tuple)
joint_states = st.builds(
    messages.JointState, headers, st.lists(st.text()).map(tuple), floats, floats, floats
)
names = st.lists(st.text(), max_size=2).map(tuple)
observations = st.builds(
    messages.Observation, headers, st.lists(poses, max_size=2).map(tuple), names
)


def bits(value):
    """Return a value whose equality is that of bits: -0.0 is not 0.0."""
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, messages.Message):
        return [bits(field) for field in msgspec.structs.astuple(value)]
    return [bits(item) for item in value] if isinstance(value, tuple) else value


@pytest.mark.parametrize("ros_type", ROS_FIELDS)
def test_the_fields_are_those_of_ros_in_their_order(ros_type):
    kind = ROS_KINDS[ros_type]
    expected = [field.partition(":") for field in ROS_FIELDS[ros_type].split()]
    assert list(kind.__struct_fields__) == [name for name, _, _ in expected]
    hints = get_type_hints(kind)
    for name, _, nested in expected:
        if nested:
            assert hints[name].__name__ == nested


def test_every_message_says_its_ros_type_or_that_it_has_none():
    assert set(ROS_KINDS) == set(ROS_FIELDS)
    for kind in KINDS:
        assert kind.ROS_TYPE in ROS_FIELDS or f"mecazen_msgs/msg/{kind.__name__}" == kind.ROS_TYPE
        assert kind.ROS_TYPE.rpartition("/")[2] == kind.__name__


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_when_everything_is_missing_expect_the_defaults(kind):
    assert decode(b"{}", kind) == kind()


@given(message=st.one_of(twists, odometries, joint_states, observations))
def test_what_comes_back_from_the_wire_is_equal_to_the_last_bit(message):
    assert bits(decode(encode(message), type(message))) == bits(message)


@given(st.integers(0, 2**31 * 10**9 - 1))
def test_a_time_in_nanoseconds_round_trips(time_ns):
    time = messages.Time.from_ns(time_ns)
    assert time.ns == time_ns
    assert decode(encode(time), messages.Time) == time


@given(st.floats(-math.pi, math.pi), finite, finite)
def test_a_planar_pose_round_trips(yaw, x, y):
    pose = messages.Pose.planar(Pose2D(x, y, yaw)).to_planar()
    assert (pose.x, pose.y) == (x, y)
    # a sine, a cosine and an arctangent, each rounded: a few times 2⁻⁵²
    assert abs(wrap(pose.yaw - yaw)) < 4e-15


def test_a_planar_pose_is_on_the_ground_and_upright():
    pose = messages.Pose.planar(Pose2D(1.0, 2.0, math.pi / 2))
    half = math.sqrt(0.5)
    assert pose.position == messages.Point(1.0, 2.0, 0.0)
    assert (pose.orientation.x, pose.orientation.y) == (0.0, 0.0)
    assert (pose.orientation.z, pose.orientation.w) == pytest.approx((half, half), rel=1e-15)


@given(
    yaw=st.floats(-3.1, 3.1),
    pitch=st.floats(-1.5, 1.5),
    roll=st.floats(-1.5, 1.5),
    length=st.sampled_from([1.0, 1e-3, 1e3, 1e200]),
)
def test_the_yaw_of_a_tilted_quaternion_of_any_length_is_that_of_its_z_y_x_angles(
    yaw, pitch, roll, length
):
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
    found = messages.Pose(orientation=orientation).to_planar().yaw
    assert abs(wrap(found - yaw)) < 1e-13


def test_planar_odometry_expect_frames_pose_twist_and_covariances():
    covariance = diagonal_covariance((1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    odometry = messages.planar_odometry(
        messages.Time(3, 4),
        "odom",
        "base_link",
        Pose2D(1.0, 2.0, 0.5),
        Twist2D(0.1, 0.2, 0.3),
        pose_covariance=covariance,
    )
    assert odometry.header == messages.Header(messages.Time(3, 4), "odom")
    assert odometry.child_frame_id == "base_link"
    assert odometry.pose.pose == messages.Pose.planar(Pose2D(1.0, 2.0, 0.5))
    assert odometry.twist.twist.to_planar() == Twist2D(0.1, 0.2, 0.3)
    assert odometry.pose.covariance == covariance
    assert odometry.twist.covariance == (0.0,) * 36
