"""The table of the graph's topics in ROS: names, messages, qualities of service and frames."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import msgspec
from mecazen import keys
from mecazen import messages as m
from mecazen.keys import Topic
from mecazen.messages import Message
from mecazen.row import Row

from mecazen_ros.description import MovingFrames
from mecazen_ros.interfaces import message
from mecazen_ros.protocol import SENSOR_DATA, Qos

TFMessage, TwistStamped = message("TFMessage"), message("TwistStamped")
WORLD = "world"
"""The frame of the truth, which all robots share."""
PERSON = "person"
"""The frame of the person as the follower estimates it."""
EXACTLY = 1e-9
"""Variance of exact values: ROS's filters refuse 0."""
FRAMES = Qos(100)

DESCRIBED: Mapping[str, type[Message]] = {
    keys.ROBOT_DESCRIPTION.key: m.String,
    "/tf_static": TFMessage,
}
"""Latched topics that describe a robot."""


class Namespace(NamedTuple):
    """A namespace of ROS names: that of the bus, followed by that of a robot."""

    name: str = ""
    """Name without slashes at its ends."""
    urdf: str = ""
    """URDF of the namespace's robot, if this process has it."""

    @property
    def prefix(self) -> str:
        """Prefix of frame names, since the frames of all robots are in one tree."""
        return f"{self.name}/" if self.name else ""

    def within(self, robot: str) -> Namespace:
        """Return the namespace of one of several robots; this namespace if the name is empty."""
        return self._replace(name=self.prefix + robot) if robot else self

    def whole(self, name: str) -> str:
        """Return a full name; a name with a leading slash is in no robot's namespace."""
        return name[1:] if name.startswith("/") else self.prefix + name


class RosTopic(NamedTuple):
    """A ROS topic that shows a topic of the graph, or whose messages go to an open topic of it."""

    name: str
    """Name, with a leading slash if it is in no robot's namespace."""
    kind: type[Message]
    qos: Qos
    convert: Callable[[Any], Any]
    """Returns the message for the other side; None if there is no message to publish."""


def name_of(row: Row, topic: Topic[Any], key: str = "") -> str:
    """Return the ROS name of a node's output; `key` is its key on the bus if that differs.

    An open topic has another name, `follower/cmd_vel`, since the nodes that receive `cmd_vel` from
    ROS already receive the output.
    """
    key = ros_name(key or topic.key)
    return f"{row.name}/{key}" if topic.open else key


def publications(topic: Topic[Any], name: str, where: Namespace) -> list[RosTopic]:
    """Return the ROS topics that show a topic; `name` is for the topic with the same message."""
    prefix = where.prefix
    plain = RosTopic(name, topic.type, Qos(), lambda seen: prefixed(seen, prefix))
    found = [plain]
    frames: Callable[[Any], Message | None] | None = None
    if topic is keys.CLOCK:
        found = [RosTopic("/clock", m.Clock, Qos(1, reliable=False), lambda clock: clock)]
    elif topic.key.startswith("diagnostics/"):
        found = [RosTopic("/diagnostics", topic.type, Qos(), lambda a: _diagnostics(a, prefix))]
    elif topic.type is m.Odometry:
        found = [plain._replace(convert=lambda o: prefixed(_uncertain(o), prefix))]
    elif topic.type is m.LaserScan:
        found = [plain._replace(qos=SENSOR_DATA, convert=lambda s: prefixed(rep_117(s), prefix))]
    elif topic.type in (m.Image, m.CameraInfo, m.Imu):
        found = [plain._replace(qos=SENSOR_DATA)]
    elif topic.type is m.BatteryState:
        found = [plain._replace(convert=lambda b: prefixed(_unmeasured(b), prefix))]
    if topic is keys.ODOM:
        frames = partial(_frame, prefix=prefix)
    elif topic is keys.JOINT_STATES and where.urdf:
        frames = MovingFrames(where.urdf, prefix)
    elif topic is keys.FOLLOWER_STATE:
        frames = partial(_person_frame, prefix=prefix)
    if frames is not None:
        found.append(RosTopic("/tf", TFMessage, FRAMES, frames))
    return found


def subscriptions(topic: Topic[Any], key: str, *, is_given: bool = True) -> list[RosTopic]:
    """Return the ROS topics that are received for a topic, if it is open or of a real sensor.

    Args:
        topic: The topic.
        key: Its key on the bus.
        is_given: Whether a node of the scenario publishes it.
    """
    if not topic.open and (is_given or not topic.sensed):
        return []
    found = [RosTopic(ros_name(key), topic.type, Qos(), lambda taken: taken)]
    if topic.type is m.LaserScan:
        found = [found[0]._replace(qos=SENSOR_DATA)]
    if topic.type is m.Twist:  # Nav2 sends either type, and each type has its own key
        found.append(RosTopic(ros_name(key), TwistStamped, Qos(), lambda stamped: stamped.twist))
    return found


def ros_name(name: str) -> str:
    """Return a key as ROS allows names: letters, digits, underscores and slashes."""
    return name.replace("-", "_")


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
            changed[name] = tuple(prefixed(one, prefix) for one in value)
    return msgspec.structs.replace(message, **changed) if changed else message


def rep_117(scan: m.LaserScan) -> m.LaserScan:
    """Return a scan with the infinities and NaN of REP-117; see `LaserScan`."""
    least, most = scan.range_min, scan.range_max

    def shown(value: float) -> float:
        if value <= 0.0:
            return math.nan
        return -math.inf if value < least else math.inf if value > most else value

    ranges = tuple(map(shown, scan.ranges))
    return msgspec.structs.replace(scan, ranges=ranges)


def _unmeasured(battery: m.BatteryState) -> m.BatteryState:
    """Return a battery's state with NaN for unmeasured quantities; see `BatteryState`."""
    names = ("temperature", "current", "charge", "capacity", "design_capacity", "percentage")
    lost = {name: math.nan for name in names if getattr(battery, name) == 0.0}
    return msgspec.structs.replace(battery, **lost)


def _diagnostics(array: m.DiagnosticArray, prefix: str) -> m.DiagnosticArray:
    """Return diagnostics whose names begin with the robot's namespace."""
    if not prefix:
        return array
    return m.DiagnosticArray(
        header=array.header,
        status=tuple(msgspec.structs.replace(one, name=prefix + one.name) for one in array.status),
    )


def _uncertain(odometry: m.Odometry) -> m.Odometry:
    """Return an odometry without a variance of 0."""

    def no_zero(covariance: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(
            EXACTLY if value == 0.0 and index % 7 == 0 else value
            for index, value in enumerate(covariance)
        )

    parts = {
        part: msgspec.structs.replace(given, covariance=no_zero(given.covariance))
        for part, given in (("pose", odometry.pose), ("twist", odometry.twist))
    }
    return msgspec.structs.replace(odometry, **parts)


def _frame(odometry: m.Odometry, prefix: str, child: str = "") -> Any:
    """Return the child frame of an odometry, relative to the odometry's frame."""
    frame, pose = odometry.header.frame_id, odometry.pose.pose
    at = pose.position
    header = m.Header(odometry.header.stamp, frame if frame == WORLD else prefix + frame)
    moved = message("Transform")(m.Vector3(at.x, at.y, at.z), pose.orientation)
    child = prefix + (child or odometry.child_frame_id)
    return TFMessage((message("TransformStamped")(header, child, moved),))


def _person_frame(state: m.FollowerState, prefix: str) -> Any:
    """Return the estimated frame of the person; None until first seen."""
    if not state.estimate:
        return None
    seen = msgspec.structs.replace(state.estimate[0], header=state.header)
    return _frame(seen, prefix, PERSON)
