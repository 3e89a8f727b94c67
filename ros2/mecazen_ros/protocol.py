"""The protocol of rmw_zenoh: keys, liveliness tokens and attachments; the tokens of the DDS bridge.

From the sources of ros2/rmw_zenoh: `liveliness_utils.cpp`, `attachment_helpers.cpp`. Keys,
tokens and attachments are one format from Jazzy to Lyrical; Humble differs in the type hash.
The functions at the end return the expressions that rules of access need.
"""

from __future__ import annotations

import hashlib
import struct
import time
from collections.abc import Collection
from typing import Any

import zenoh
from mecazen import keys
from mecazen.errors import RefusedError
from mecazen.keys import Call, Topic
from mecazen.robots import join_key
from mecazen.row import Row

from mecazen_ros.services import OF_NODE, OF_SIMULATION
from mecazen_ros.topics import DESCRIBED, name_of, publications, subscriptions
from mecazen_ros.types import type_hash

ADMIN = "@ros2_lv"
"""The first chunk of every liveliness token."""
NO_HASH = "TypeHashNotSupported"
"""Text that Humble has in place of every type hash."""
GID_BYTES = 16
_ATTACHMENT = struct.Struct(f"<qqB{GID_BYTES}s")


def attachment(sequence: int, gid: bytes) -> bytes:
    """Return the attachment of a sample that is sent now, or of a reply, which repeats both."""
    return _ATTACHMENT.pack(sequence, time.time_ns(), GID_BYTES, gid)


def sequence_and_gid(received: zenoh.Sample | zenoh.Query) -> tuple[int, bytes]:
    """Return sequence and identity in an attachment; further bytes may follow, as in rmw_zenoh.

    Raises:
        RefusedError: The attachment is not rmw_zenoh's.
    """
    data = b"" if received.attachment is None else received.attachment.to_bytes()
    if len(data) >= _ATTACHMENT.size:
        sequence, time_ns, length, gid = _ATTACHMENT.unpack_from(data)
        if sequence >= 0 and time_ns >= 0 and length == GID_BYTES:
            return sequence, gid
    raise RefusedError(f"attachment of {len(data)} bytes that is not rmw_zenoh's")


def gid_of(token: str) -> bytes:
    """Return the identity of an endpoint: 16 bytes, different for each.

    rmw_zenoh hashes the token by XXH3. No receiver checks it, so another hash is sufficient.
    """
    return hashlib.blake2b(token.encode(), digest_size=GID_BYTES).digest()


def mangled(name: str) -> str:
    """Return a full name as a part of a token."""
    return "%" + name.replace("/", "%")


def bridge_token(kind: str, key: str, ros_type: str, qos: str) -> str:
    """Return the end of a token for zenoh-bridge-ros2dds, of a publisher (MP) or a service (SS).

    From its `liveliness_mgt.rs`: reliability and durability have the numbers of DDS, with 1 for
    reliable and for transient local, and the user data have the hash of the type.
    """
    reliability, durability, history, *_ = qos.split(":")
    parts = [kind, key, ros_type]
    if kind == "MP":
        hashed = f"typehash={type_hash(ros_type)};"
        parts.append(f":{int(not reliability)}:{int(bool(durability))}:0{history}:{hashed}")
    return "/".join(part.replace("/", "§") for part in parts)


def dds_type(name: str) -> str:
    """Return the DDS name of a type: `geometry_msgs::msg::dds_::Twist_`."""
    package, space, short = name.split("/")
    return f"{package}::{space}::dds_::{short}_"


def any_key(name: str, ros_type: str, namespace: str | None = None) -> str:
    """Return the expression of a topic's or service's keys in every domain.

    Without a namespace it matches any, and longer names such as `guard/cmd_vel`.
    """
    before = "**" if namespace is None else join_key(namespace, "*").removesuffix("/")
    return f"{before}/{name.removeprefix('/')}/{dds_type(ros_type)}/*"


def published_keys(row: Row, topic: Topic[Any]) -> list[str]:
    """Return the keys on which ROS receives an output of a node."""
    shown = publications(topic, name_of(row, topic), "")
    return [any_key(ros_topic.name, ros_topic.kind.ROS_TYPE) for ros_topic in shown]


def received_keys(topic: Topic[Any], robot: str = "", namespace: str | None = None) -> list[str]:
    """Return the keys on which a topic is received from ROS; in any namespace if none is named."""
    return [
        any_key(join_key(ros_topic.name, robot), ros_topic.kind.ROS_TYPE, namespace)
        for ros_topic in subscriptions(topic, topic.key)
    ]


def service_keys(calls: Collection[Call[Any, Any]]) -> list[str]:
    """Return the keys of the ROS services that make any of some queries."""
    services = (*OF_SIMULATION, *OF_NODE)
    return [any_key(service.name, service.kind) for service in services if service.call in calls]


def latched_keys(call: Call[Any, Any]) -> list[str]:
    """Return the keys on which an answer to a query is published once, for late subscribers."""
    if call is not keys.ROBOT_DESCRIPTION:
        return []
    return [any_key(name, kind.ROS_TYPE) for name, kind in DESCRIBED.items()]


def tokens(service: str = "") -> str:
    """Return the liveliness tokens of a service's ROS node; of all services if none is named."""
    return f"{ADMIN}/*/*/*/*/*/*/*/{service}/**" if service else f"{ADMIN}/**"
