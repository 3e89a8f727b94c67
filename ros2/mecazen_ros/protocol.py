"""The protocol of rmw_zenoh: names, qualities of service, attachments.

From the sources of ros2/rmw_zenoh: `liveliness_utils.cpp`, `attachment_helpers.cpp`. Keys,
tokens and attachments are one format from Jazzy to Lyrical; Humble differs in the type hash.
"""

from __future__ import annotations

import hashlib
import struct
from typing import NamedTuple

from mecazen.errors import RefusedError

ADMIN = "@ros2_lv"
"""The first chunk of every liveliness token."""
NO_HASH = "TypeHashNotSupported"
"""Text that Humble has in place of every type hash."""
GID_BYTES = 16

_ATTACHMENT = struct.Struct(f"<qqB{GID_BYTES}s")


class Qos(NamedTuple):
    """Quality of service as mecazen uses it: the newest `depth` samples are kept."""

    depth: int = 10
    reliable: bool = True
    latched: bool = False
    """Whether late subscribers receive the newest samples (transient local)."""

    @property
    def text(self) -> str:
        """The six fields of a token; a field with rmw_zenoh's default is empty."""
        reliability = "" if self.reliable else "2"
        durability = "1" if self.latched else ""
        return f"{reliability}:{durability}:,{self.depth}:,:,:,,"


SENSOR_DATA = Qos(5, reliable=False)
LATCHED = Qos(1, latched=True)
PARAMETERS = Qos(1000)


class Attachment(NamedTuple):
    """The attachment of every sample, request and reply."""

    sequence: int
    """Number from 1; a reply repeats that of its request."""
    time_ns: int
    """Wall time at which the message was sent."""
    gid: bytes
    """Identity of the publisher or client."""

    def pack(self) -> bytes:
        """Return the attachment as bytes."""
        return _ATTACHMENT.pack(self.sequence, self.time_ns, GID_BYTES, self.gid)

    @classmethod
    def unpack(cls, attachment: bytes) -> Attachment:
        """Return the attachment in some bytes; further bytes may follow, as in rmw_zenoh.

        Raises:
            RefusedError: The bytes are no attachment of rmw_zenoh.
        """
        if len(attachment) < _ATTACHMENT.size:
            raise RefusedError(
                f"attachment of {len(attachment)} bytes, rmw_zenoh's has {_ATTACHMENT.size}"
            )
        sequence, time_ns, length, gid = _ATTACHMENT.unpack_from(attachment)
        if sequence < 0 or time_ns < 0 or length != GID_BYTES:
            raise RefusedError("attachment that is not rmw_zenoh's")
        return cls(sequence, time_ns, gid)


class Node(NamedTuple):
    """A ROS node on a Zenoh session."""

    domain: int
    session: str
    """The session's identity, as Zenoh prints it."""
    number: int
    """Number of the node in its session."""
    namespace: str
    """Namespace without slashes at its ends; empty for the root."""
    name: str

    @property
    def token(self) -> str:
        """The liveliness token of the node itself."""
        return self._token(self.number, "NN")

    def endpoint(self, number: int, kind: str, topic: str, dds: str, hashed: str, qos: Qos) -> str:
        """Return the liveliness token of a publisher, subscriber or service.

        Args:
            number: Number of the endpoint in its session; nodes and endpoints share numbers.
            kind: MP, MS or SS.
            topic: Whole name of the topic or service, without a leading slash.
            dds: The type, in DDS's spelling.
            hashed: The type's hash.
            qos: Quality of service of the endpoint.
        """
        return f"{self._token(number, kind)}/{_mangled(topic)}/{dds}/{hashed}/{qos.text}"

    def _token(self, number: int, kind: str) -> str:
        place = f"{self.domain}/{self.session}/{self.number}/{number}/{kind}"
        return f"{ADMIN}/{place}/%/{_mangled(self.namespace)}/{self.name}"


def _mangled(name: str) -> str:
    return "%" + name.replace("/", "%")


def dds_type(name: str) -> str:
    """Return the DDS name of a type: `geometry_msgs::msg::dds_::Twist_`."""
    package, space, own = name.split("/")
    return f"{package}::{space}::dds_::{own}_"


def data_key(domain: int, topic: str, dds: str, hashed: str) -> str:
    """Return the key of a topic's samples, or of a service's requests."""
    return f"{domain}/{topic}/{dds}/{hashed}"


def any_key(name: str, dds: str, namespace: str | None = None) -> str:
    """Return the expression of a topic's or service's keys in every domain, and any namespace.

    Without a namespace it also matches longer names, such as `guard/cmd_vel`.
    """
    before = "**" if namespace is None else "/".join(filter(None, ("*", namespace)))
    return f"{before}/{name.removeprefix('/')}/{dds}/*"


def gid_of(token: str) -> bytes:
    """Return the identity of an endpoint: 16 bytes, different for each.

    rmw_zenoh hashes the token by XXH3. No receiver checks it, so another hash is sufficient.
    """
    return hashlib.blake2b(token.encode(), digest_size=GID_BYTES).digest()
