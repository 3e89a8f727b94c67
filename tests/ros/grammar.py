"""What rmw_zenoh reads: liveliness tokens, data keys, QoS and attachments.

Written from ros2/rmw_zenoh: `liveliness_utils.cpp` (Entity::make, keyexpr_to_qos, TopicInfo) and
`attachment_helpers.cpp`; names from ROS 2's design, "Topic and Service name mapping". It shares
nothing with what it checks. What it can't read raises ValueError.
"""

import re
import struct
from typing import NamedTuple

KINDS = {"NN", "MP", "MS", "SS", "SC"}
"""A node, a publisher of messages, a subscriber of them, a service's server, its client."""

BASE = r"[A-Za-z_][A-Za-z0-9_]*"
NODE_NAME = re.compile(BASE)
FULL_NAME = re.compile(rf"(/{BASE})+")
DDS_TYPE = re.compile(rf"({BASE})::(msg|srv)::dds_::([A-Z][A-Za-z0-9]*)_")
TYPE_HASH = re.compile(r"RIHS01_[0-9a-f]{64}")
INFINITE = (9223372036, 854775807)
"""RMW_DURATION_INFINITE: seconds and nanoseconds."""


class Qos(NamedTuple):
    """What a token says of the quality of service, with rmw_zenoh's defaults."""

    reliable: bool
    latched: bool
    """Transient local: a late subscriber gets the last samples."""
    keep_all: bool
    depth: int
    deadline: tuple[int, int]
    lifespan: tuple[int, int]
    lease: tuple[int, int]


class Data(NamedTuple):
    """The key of a topic or a service."""

    domain: int
    name: str
    """With a leading slash, as ROS has it."""
    type: str
    """Such as geometry_msgs/msg/Twist."""
    hash: str


class Entity(NamedTuple):
    """What a token declares."""

    zid: str
    node_id: int
    id: int
    kind: str
    namespace: str
    node: str
    data: Data | None
    qos: Qos | None


class Attachment(NamedTuple):
    """What comes with each sample, request and answer."""

    sequence: int
    time_ns: int
    gid: bytes


def token(text: str) -> Entity:
    """Read a liveliness token."""
    parts = text.split("/")
    admin, domain, zid, node_id, number, kind = parts[:6]
    if admin != "@ros2_lv" or kind not in KINDS or not all(parts):
        raise ValueError(f"no token: {text}")
    if len(parts) != (9 if kind == "NN" else 13):
        raise ValueError(f"{len(parts)} parts: {text}")
    if not re.fullmatch("[1-9a-f][0-9a-f]*", zid):
        raise ValueError(f"a session's id is hexadecimal, without leading zeros: {text}")
    enclave, namespace, node = (part.replace("%", "/") for part in parts[6:9])
    for name in (enclave, namespace):
        if name != "/" and not FULL_NAME.fullmatch(name):
            raise ValueError(f"{name!r} is no namespace: {text}")
    if not NODE_NAME.fullmatch(node):
        raise ValueError(f"{node!r} is no name of a node: {text}")
    ids = _number(node_id), _number(number)
    if kind == "NN":
        if ids[0] != ids[1]:
            raise ValueError(f"a node has one id: {text}")
        _number(domain)
        return Entity(zid, *ids, kind, namespace, node, None, None)
    topic, dds_type, type_hash, quality = parts[9:]
    described = _data(domain, topic.replace("%", "/"), dds_type, type_hash)
    if (kind in {"SS", "SC"}) != ("/srv/" in described.type):
        raise ValueError(f"{described.type} of a {kind}: {text}")
    return Entity(zid, *ids, kind, namespace, node, described, qos(quality))


def key(text: str) -> Data:
    """Read the key that samples, or requests, go on."""
    domain, *topic, dds_type, type_hash = text.split("/")
    return _data(domain, "/" + "/".join(topic), dds_type, type_hash)


def _data(domain: str, name: str, dds_type: str, type_hash: str) -> Data:
    found = DDS_TYPE.fullmatch(dds_type)
    if not FULL_NAME.fullmatch(name) or found is None or not TYPE_HASH.fullmatch(type_hash):
        raise ValueError(f"no topic: {name} {dds_type} {type_hash}")
    return Data(_number(domain), name, "/".join(found.groups()), type_hash)


def qos(text: str) -> Qos:
    """Read the last part of a token: 6 fields, in which empty means the default."""
    reliability, durability, history, deadline, lifespan, liveliness = text.split(":")
    kind, depth = history.split(",")
    automatic, *lease = liveliness.split(",")
    for given, allowed in (
        (reliability, "12"),
        (durability, "12"),
        (kind, "12"),
        (automatic, "1"),
    ):
        if given and given not in allowed:
            raise ValueError(f"{given!r} in {text}")
    return Qos(
        reliability != "2",
        durability == "1",
        kind == "2",
        _number(depth) if depth else 42,
        _duration(deadline.split(",")),
        _duration(lifespan.split(",")),
        _duration(lease),
    )


def _duration(parts: list[str]) -> tuple[int, int]:
    seconds, nanoseconds = parts
    return (
        _number(seconds) if seconds else INFINITE[0],
        _number(nanoseconds) if nanoseconds else INFINITE[1],
    )


def attachment(data: bytes) -> Attachment:
    """Read an attachment; receivers stop after the three fields."""
    sequence, time_ns, length = struct.unpack_from("<qqB", data)
    if sequence < 0 or time_ns < 0 or length != 16 or len(data) < 33:
        raise ValueError(f"no attachment: {data.hex()}")
    return Attachment(sequence, time_ns, data[17:33])


def _number(text: str) -> int:
    if not re.fullmatch("0|[1-9][0-9]*", text):
        raise ValueError(f"{text!r} is no number")
    return int(text)
