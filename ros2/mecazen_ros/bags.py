"""Recordings of rosbag2, MCAP or SQLite, read by rosbags, and poses in the types that they hold."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import apsw
from mecazen.errors import MecazenError, RefusedError
from mecazen.messages import Odometry, Point, Pose, PoseWithCovariance
from rosbags.rosbag2 import Reader, ReaderError

from mecazen_ros import cdr
from mecazen_ros.topics import TF, TF_STATIC, TFMessage, TransformStamped
from mecazen_ros.types import message

PoseStamped = message("geometry_msgs/msg/PoseStamped")
PoseWithCovarianceStamped = message("geometry_msgs/msg/PoseWithCovarianceStamped")
POSE_TYPES: dict[str, Any] = {
    kind.ROS_TYPE: kind
    for kind in (Odometry, PoseStamped, PoseWithCovarianceStamped, TransformStamped, TFMessage)
}
"""Types of messages that `odometry` takes."""
TREES = (TF, TF_STATIC)
"""Topics of many frames."""
_DAMAGE = (ReaderError, OSError, apsw.Error, struct.error, ValueError, EOFError)


def read_bag(path: Path) -> Iterator[tuple[str, str, int, bytes]]:
    """Yield topic, ROS type, time of the record [ns] and payload in CDR of the messages of a bag.

    A bag is a file (.mcap, .db3), or a folder with metadata.yaml.

    Raises:
        MecazenError: It can't be read.
    """
    try:
        with Reader(path) as bag:
            for connection, time_ns, payload in bag.messages():
                yield connection.topic, connection.msgtype, time_ns, bytes(payload)
    except _DAMAGE as error:
        reason = str(error).partition("\n")[0]
        raise MecazenError(f"{path}: can't be read as a recording of ROS 2: {reason}") from None


def odometry(payload: bytes, kind: str, frame: str = "") -> Odometry | None:
    """Return the pose in a message of `POSE_TYPES`, without a velocity if the type has none.

    Transforms are chosen by their child frame; without a `frame` there must be only one. The result
    is None for transforms of other frames.

    Raises:
        RefusedError: It is not of this type, or holds several frames and none is named.
    """
    content: Any = cdr.decode(payload, POSE_TYPES[kind])
    if isinstance(content, Odometry):
        return content
    if isinstance(content, PoseStamped):
        return Odometry(content.header, "", PoseWithCovariance(content.pose))
    if isinstance(content, PoseWithCovarianceStamped):
        return Odometry(content.header, "", content.pose)
    transforms = content.transforms if isinstance(content, TFMessage) else (content,)
    if not frame and len(transforms) > 1:
        names = ", ".join(transform.child_frame_id for transform in transforms)
        raise RefusedError(f"holds the frames {names}; KEY=TOPIC:FRAME chooses one")
    for stamped in transforms:
        if frame in ("", stamped.child_frame_id):
            place = stamped.transform.translation
            pose = Pose(Point(place.x, place.y, place.z), stamped.transform.rotation)
            return Odometry(stamped.header, stamped.child_frame_id, PoseWithCovariance(pose))
    return None
