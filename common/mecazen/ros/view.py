"""How the graph's topics look in ROS: the one table of names, messages, qualities and frames."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import msgspec

from mecazen import keys
from mecazen import messages as m
from mecazen.keys import Topic
from mecazen.messages import Message
from mecazen.ros import interfaces as i
from mecazen.ros.description import MovingFrames
from mecazen.ros.protocol import SENSOR_DATA, Qos
from mecazen.row import Row

WORLD = "world"
"""The frame of the truth, which all robots share."""
PERSON = "person"
"""The frame of the person as the follower believes them to be."""
EXACTLY = 1e-9
"""The variance of what is exact: to ROS's filters 0 is a mistake."""
FRAMES = Qos(100)

DESCRIBED: Mapping[str, type[Message]] = {
    keys.ROBOT_DESCRIPTION.key: m.String,
    "/tf_static": i.TFMessage,
}
"""What is published, latched, of a robot's description."""

Convert = Callable[[Any], Message | None]


class Place(NamedTuple):
    """Whose topics they are."""

    namespace: str = ""
    """Of ROS names, without slashes at its ends: the bus's, and then a robot's."""
    urdf: str = ""
    """Where the robot is described in this process."""

    @property
    def prefix(self) -> str:
        """Begins the names of frames, which all robots have in one tree."""
        return f"{self.namespace}/" if self.namespace else ""

    def within(self, robot: str) -> Place:
        """Return the place of one of several robots; itself where the name is empty."""
        return self._replace(namespace=self.prefix + robot) if robot else self

    def whole(self, name: str) -> str:
        """Return a ROS name without its leading slash; one that has it is of no robot."""
        return name[1:] if name.startswith("/") else self.prefix + name


class View(NamedTuple):
    """What ROS sees of a topic."""

    name: str
    """Of the ROS topic; with a leading slash in no robot's namespace."""
    kind: type[Message]
    qos: Qos
    convert: Convert
    """Gives the ROS message, or None where there is none to publish."""


class Entry(NamedTuple):
    """A ROS topic that is taken in the place of one that anyone may publish on."""

    name: str
    kind: type[Message]
    convert: Callable[[Any], Message]


def name_of(row: Row, topic: Topic[Any]) -> str:
    """Return the name of a topic that a node gives.

    One that is taken from ROS has another where a node gives it, `follower/cmd_vel`: what the
    node says must not come back to those who hear it already.
    """
    key = ros_name(row.on_bus(topic).key)
    return f"{row.name}/{key}" if topic.open else key


def views(topic: Topic[Any], name: str, place: Place) -> list[View]:
    """Return what ROS sees of a topic, if nothing else is to be said under this name."""
    prefix = place.prefix
    plain = View(name, topic.type, Qos(), lambda message: prefixed(message, prefix))
    frames = View("/tf", i.TFMessage, FRAMES, _nothing)
    if topic is keys.CLOCK:
        return [View("/clock", m.Clock, Qos(1, reliable=False), _same)]
    if topic.key.startswith("diagnostics/"):
        return [View("/diagnostics", topic.type, Qos(), lambda a: _diagnostics(a, prefix))]
    if topic.type is m.Odometry:
        seen = [plain._replace(convert=lambda o: prefixed(_uncertain(o), prefix))]
        if topic is keys.ODOM:
            seen.append(frames._replace(convert=lambda o: _odometry_frame(o, prefix)))
        return seen
    if topic is keys.JOINT_STATES and place.urdf:
        return [plain, frames._replace(convert=MovingFrames(place.urdf, prefix))]
    if topic is keys.FOLLOWER_STATE:
        return [plain, frames._replace(convert=lambda state: _person_frame(state, prefix))]
    if topic.type is m.LaserScan:
        return [plain._replace(qos=SENSOR_DATA, convert=lambda s: prefixed(rep_117(s), prefix))]
    if topic.type in (m.Image, m.CameraInfo):
        return [plain._replace(qos=SENSOR_DATA)]
    return [plain]


def entries(topic: Topic[Any], key: str) -> list[Entry]:
    """Return the ROS topics that are taken in the place of a topic; none but of open ones."""
    if not topic.open:
        return []
    name = ros_name(key)
    taken = [Entry(name, topic.type, lambda message: message)]
    if topic.type is m.Twist:  # Nav2 sends either, and a type is another key
        taken.append(Entry(name, i.TwistStamped, lambda stamped: stamped.twist))
    return taken


def ros_name(name: str) -> str:
    """Return a key as ROS allows names: letters, digits, underscores and slashes."""
    return name.replace("-", "_")


def prefixed(message: Any, prefix: str) -> Any:
    """Return a message whose frames have a prefix; the world, which all share, has none."""
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
    """Return a scan with infinity where nothing was within range, and NaN where nothing is known.

    JSON has neither; see `LaserScan`.
    """
    most = scan.range_max
    ranges = tuple((r if r <= most else math.inf) if r > 0.0 else math.nan for r in scan.ranges)
    return msgspec.structs.replace(scan, ranges=ranges)


def _same(message: Message) -> Message:
    return message


def _nothing(message: Message) -> None:
    del message


def _diagnostics(array: m.DiagnosticArray, prefix: str) -> m.DiagnosticArray:
    """Return health under names that tell robots apart."""
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

    pose, twist = odometry.pose, odometry.twist
    return m.Odometry(
        header=odometry.header,
        child_frame_id=odometry.child_frame_id,
        pose=m.PoseWithCovariance(pose=pose.pose, covariance=no_zero(pose.covariance)),
        twist=m.TwistWithCovariance(twist=twist.twist, covariance=no_zero(twist.covariance)),
    )


def _frame(header: m.Header, child: str, pose: m.Pose, prefix: str) -> i.TFMessage:
    at, frame = pose.position, header.frame_id
    parent = frame if frame == WORLD else prefix + frame
    moved = i.Transform(translation=m.Vector3(at.x, at.y, at.z), rotation=pose.orientation)
    header = m.Header(stamp=header.stamp, frame_id=parent)
    return i.TFMessage(transforms=(i.TransformStamped(header, prefix + child, moved),))


def _odometry_frame(odometry: m.Odometry, prefix: str) -> i.TFMessage:
    return _frame(odometry.header, odometry.child_frame_id, odometry.pose.pose, prefix)


def _person_frame(state: m.FollowerState, prefix: str) -> i.TFMessage | None:
    """Return where the person is believed to be; None until first seen."""
    if not state.estimate:
        return None
    return _frame(state.header, PERSON, state.estimate[0].pose.pose, prefix)
