"""The table of the graph's topics in ROS: names, messages, qualities of service and frames."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import msgspec
from mecazen import keys
from mecazen import messages as m
from mecazen.arrays import quaternions_of_rpy
from mecazen.keys import Topic
from mecazen.messages import Message
from mecazen.robots import join_key
from mecazen.row import Row
from mecazen.urdf import read

from mecazen_ros.types import message

TFMessage = message("tf2_msgs/msg/TFMessage")
TransformStamped = message("geometry_msgs/msg/TransformStamped")
Transform = message("geometry_msgs/msg/Transform")
TwistStamped = message("geometry_msgs/msg/TwistStamped")
TF, TF_STATIC = "/tf", "/tf_static"
WORLD = "world"
"""The frame of the truth, which all robots share."""
PERSON = "person"
"""The frame of the person as the follower estimates it."""
EXACTLY = 1e-9  # variance of exact values: ROS's filters refuse 0
RELIABLE = "::,10:,:,:,,"
"""Quality of service as a token of rmw_zenoh has it; fields with its defaults are empty."""
SENSOR_DATA, NEWEST = "2::,5:,:,:,,", "2::,1:,:,:,,"  # best effort
FRAMES = "::,100:,:,:,,"
PARAMETERS = "::,1000:,:,:,,"
LATCHED = ":1:,1:,:,:,,"  # transient local: late subscribers receive the newest sample
QOS: Mapping[Any, str] = {m.Clock: NEWEST} | dict.fromkeys(
    (m.LaserScan, m.Image, m.CameraInfo, m.Imu), SENSOR_DATA
)
DESCRIBED: Mapping[str, Any] = {keys.ROBOT_DESCRIPTION.key: m.String, TF_STATIC: TFMessage}
"""Latched topics that describe a robot."""


class RosTopic(NamedTuple):
    """A ROS topic that shows a topic of the graph, or whose messages go to an open topic of it."""

    name: str
    """Name, with a leading slash if it is in no robot's namespace."""
    kind: type[Message]
    qos: str = RELIABLE
    convert: Callable[[Any], Any] = lambda message: message
    """Returns the message for the other side; None if there is no message to publish."""


def ros_name(name: str) -> str:
    """Return a key as ROS allows names: letters, digits, underscores and slashes."""
    return name.replace("-", "_")


def full_name(name: str, namespace: str) -> str:
    """Return a full name; a name with a leading slash is in no robot's namespace."""
    return name[1:] if name.startswith("/") else join_key(name, namespace)


def name_of(row: Row, topic: Topic[Any], key: str = "") -> str:
    """Return the ROS name of a node's output; `key` is its key on the bus if that differs.

    An open topic has another name, `follower/cmd_vel`, since the nodes that receive `cmd_vel` from
    ROS already receive the output.
    """
    key = ros_name(key or topic.key)
    return f"{row.name}/{key}" if topic.open else key


def publications(
    topic: Topic[Any], name: str, namespace: str, *, odom_tf: bool = True
) -> list[RosTopic]:
    """Return the ROS topics that show a topic: one of this name, and frames."""
    prefix = join_key("", namespace)
    if topic.key.startswith("diagnostics/"):
        named = partial(_diagnostics, prefix=prefix)
        return [RosTopic("/diagnostics", topic.type, convert=named)]
    if topic is keys.CLOCK:
        name = "/clock"
    to_ros = CONVERSIONS.get(topic.type, lambda message: message)
    qos = QOS.get(topic.type, RELIABLE)
    shown = [RosTopic(name, topic.type, qos, lambda message: prefixed(to_ros(message), prefix))]
    if topic is keys.ODOM and odom_tf:
        shown.append(RosTopic(TF, TFMessage, FRAMES, partial(_frames, prefix=prefix)))
    elif topic is keys.FOLLOWER_STATE:
        shown.append(RosTopic(TF, TFMessage, FRAMES, partial(_person_frame, prefix=prefix)))
    return shown


def subscriptions(topic: Topic[Any], key: str, *, has_source: bool = True) -> list[RosTopic]:
    """Return the ROS topics that are received for a topic with a key on the bus.

    It must be open, or of a sensor that no node of the scenario has as a source.
    """
    if not topic.open and (has_source or not topic.sensed):
        return []
    name = ros_name(key)
    received = [RosTopic(name, topic.type, QOS.get(topic.type, RELIABLE))]
    if topic.type is m.Twist:  # Nav2 sends either type, and each type has its own key
        received.append(RosTopic(name, TwistStamped, convert=lambda stamped: stamped.twist))
    return received


def prefixed(message: Any, prefix: str) -> Any:
    """Return a message whose frames have a prefix; the frame `world`, which all share, has none."""
    if not prefix:
        return message
    changed: dict[str, Any] = {}
    for name in message.__struct_fields__:
        value = getattr(message, name)
        if name in ("frame_id", "child_frame_id"):
            if value not in ("", WORLD):
                changed[name] = prefix + value
        elif isinstance(value, Message):
            changed[name] = prefixed(value, prefix)
        elif isinstance(value, tuple) and value and isinstance(value[0], Message):
            changed[name] = tuple(prefixed(item, prefix) for item in value)
    return msgspec.structs.replace(message, **changed) if changed else message


def to_rep_117(scan: m.LaserScan) -> m.LaserScan:
    """Return a scan with the infinities and NaN of REP-117; see `LaserScan`."""
    least, most = scan.range_min, scan.range_max

    def shown(value: float) -> float:
        if value <= 0.0:
            return math.nan
        return -math.inf if value < least else math.inf if value > most else value

    return msgspec.structs.replace(scan, ranges=tuple(map(shown, scan.ranges)))


def _with_unmeasured(battery: m.BatteryState) -> m.BatteryState:
    """Return a battery's state with NaN for unmeasured quantities; see `BatteryState`."""
    names = ("temperature", "current", "charge", "capacity", "design_capacity", "percentage")
    unmeasured = {name: math.nan for name in names if getattr(battery, name) == 0.0}
    return msgspec.structs.replace(battery, **unmeasured)


def _without_zero_variance(odometry: m.Odometry) -> m.Odometry:
    parts: dict[str, Any] = {"pose": odometry.pose, "twist": odometry.twist}
    for name, part in parts.items():
        covariance = list(part.covariance)
        covariance[::7] = [value or EXACTLY for value in covariance[::7]]  # on the diagonal
        parts[name] = msgspec.structs.replace(part, covariance=tuple(covariance))
    return msgspec.structs.replace(odometry, **parts)


CONVERSIONS: Mapping[type[Message], Callable[[Any], Any]] = {
    m.BatteryState: _with_unmeasured,
    m.LaserScan: to_rep_117,
    m.Odometry: _without_zero_variance,
}


def _diagnostics(array: m.DiagnosticArray, prefix: str) -> m.DiagnosticArray:
    status = [msgspec.structs.replace(part, name=prefix + part.name) for part in array.status]
    return msgspec.structs.replace(array, status=tuple(status))


def child_frame(odometry: m.Odometry) -> Any:
    """Return the child frame of an odometry relative to its frame, as a TransformStamped."""
    pose = odometry.pose.pose
    transform = Transform(m.Vector3(*msgspec.structs.astuple(pose.position)), pose.orientation)
    return TransformStamped(odometry.header, odometry.child_frame_id, transform)


def _frames(odometry: m.Odometry, prefix: str) -> Any:
    return prefixed(TFMessage((child_frame(odometry),)), prefix)


def _person_frame(state: m.FollowerState, prefix: str) -> Any:
    """Return the estimated frame of the person; None until first seen."""
    if not state.estimate:
        return None
    estimate = state.estimate[0]
    return _frames(m.Odometry(state.header, PERSON, estimate.pose, estimate.twist), prefix)


def fixed_frames(urdf: str, prefix: str) -> Any:
    """Return the frames of links fixed to other links, such as sensors; none of joints."""
    frames = []
    for joint in read(urdf).joints:
        if joint.kind == "fixed":
            rotation = m.Quaternion(*quaternions_of_rpy(joint.origin.rpy).tolist())
            transform = Transform(m.Vector3(*joint.origin.xyz), rotation)
            frames.append(TransformStamped(m.Header(frame_id=joint.parent), joint.child, transform))
    return prefixed(TFMessage(tuple(frames)), prefix)
