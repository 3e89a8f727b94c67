"""What rmw_zenoh reads: liveliness tokens, data keys, QoS and attachments; the DDS bridge's tokens.

Written from ros2/rmw_zenoh: `liveliness_utils.cpp` (Entity::make, keyexpr_to_qos, TopicInfo) and
`attachment_helpers.cpp`, and from zenoh-plugin-ros2dds, `liveliness_mgt.rs`; names from ROS 2's
design. Text outside the grammar raises ValueError.
"""

import re
import struct
from typing import Any, NamedTuple

from mcap_ros2._dynamic import generate_dynamic

NUMBER = "(?:0|[1-9][0-9]*)"
BASE = "[A-Za-z_][A-Za-z0-9_]*"
DDS = rf"(?P<package>{BASE})::(?P<space>msg|srv)::dds_::(?P<own>[A-Z][A-Za-z0-9]*)_"
HASH = "(?P<hash>RIHS01_[0-9a-f]{64})"
DURATION = f"{NUMBER}?,{NUMBER}?"
QOS = f"[12]?:(?P<durability>[12]?):[12]?,{NUMBER}?:{DURATION}:{DURATION}:1?,{DURATION}"
KEY = re.compile(f"(?P<domain>{NUMBER})(?P<name>(?:/{BASE})+)/{DDS}/{HASH}")
TOKEN = re.compile(
    f"@ros2_lv/(?P<domain>{NUMBER})/(?P<zid>[1-9a-f][0-9a-f]*)/(?P<node_id>{NUMBER})/"
    f"(?:(?P<id>(?P=node_id))/(?P<kind>NN)|(?P<number>{NUMBER})/(?P<end>MP|MS|SS|SC))/"
    # enclave, namespace and name of the node
    f"%/(?P<namespace>%|(?:%{BASE})+)/(?P<node>{BASE})"
    # a topic or a service, which a node itself does not have
    f"(?(end)/(?P<name>(?:%{BASE})+)/{DDS}/{HASH}/{QOS})"
)

BRIDGE = re.compile(
    "@/[1-9a-f][0-9a-f]*/@ros2_lv/(?P<kind>MP|SS)/(?P<key>[^/]+)/(?P<type>[^/]+)"
    # keyless: reliability: durability: history, depth: user data, of publishers only
    f"(?:/:[01]:(?P<durability>[01]):0,[1-9][0-9]*:typehash={HASH};)?"
)


class Data(NamedTuple):
    """The key of a topic or a service."""

    domain: int
    name: str
    """With a leading slash, as ROS has it."""
    type: str
    """Such as geometry_msgs/msg/Twist."""
    hash: str

    @property
    def key(self) -> str:
        """The key of samples or requests, as Zenoh has it."""
        package, space, short = self.type.split("/")
        return f"{self.domain}{self.name}/{package}::{space}::dds_::{short}_/{self.hash}"


class Entity(NamedTuple):
    """The declared end: a node, publisher, subscriber, service or client."""

    zid: str
    node_id: int
    id: int
    kind: str
    namespace: str
    node: str
    data: Data | None
    latched: bool
    """Transient local: a late subscriber gets the last samples."""


def _matched(pattern: re.Pattern[str], text: str) -> dict[str, str | None]:
    found = pattern.fullmatch(text)
    if found is None:
        raise ValueError(f"not of the grammar: {text}")
    return found.groupdict()


def _data(part: dict[str, str | None]) -> Data:
    kind = "/".join((part["package"], part["space"], part["own"]))
    return Data(int(part["domain"]), part["name"].replace("%", "/"), kind, part["hash"])


def token(text: str) -> Entity:
    """Read a liveliness token."""
    part = _matched(TOKEN, text)
    kind, number = part["kind"] or part["end"], int(part["id"] or part["number"])
    data = None if kind == "NN" else _data(part)
    if data is not None and (kind in {"SS", "SC"}) != ("/srv/" in data.type):
        raise ValueError(f"{data.type} of a {kind}: {text}")
    node = part["namespace"].replace("%", "/"), part["node"]
    return Entity(
        part["zid"], int(part["node_id"]), number, kind, *node, data, part["durability"] == "1"
    )


def bridge_token(text: str) -> tuple[str, str, str, str | None]:
    """Read kind, key, type and durability of a token of the bridge."""
    part = _matched(BRIDGE, text)
    if (part["kind"] == "MP") != (part["durability"] is not None):
        raise ValueError(f"not of the grammar: {text}")
    return part["kind"], *(part[n].replace("§", "/") for n in ("key", "type")), part["durability"]


def key(text: str) -> Data:
    """Read the key that samples, or requests, go on."""
    return _data(_matched(KEY, text))


def attachment(data: bytes) -> tuple[int, int, bytes]:
    """Read sequence, time [ns] and identity; receivers stop after these three fields."""
    sequence, time_ns, length = struct.unpack_from("<qqB", data)
    if sequence < 0 or time_ns < 0 or length != 16 or len(data) < 33:
        raise ValueError(f"no attachment: {data.hex()}")
    return sequence, time_ns, data[17:33]


def message(payload: bytes, kind: str, definition: str) -> Any:
    """Read CDR as plain values, by mcap-ros2-support."""
    return _plain(generate_dynamic(kind, definition)[kind](payload))


def _plain(value: Any) -> Any:
    if hasattr(value, "__slots__"):
        return {name: _plain(getattr(value, name)) for name in value.__slots__}
    return [_plain(item) for item in value] if isinstance(value, list | bytes) else value
