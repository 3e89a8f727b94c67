"""Names, definitions and hashes of ROS 2's types and services, from the structs."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from hashlib import sha256
from types import MappingProxyType
from typing import Annotated, Any, ClassVar

import msgspec

from mecazen.messages import Message, Time, UInt8
from mecazen.ros.fields import Field, fields

_Fields = tuple[Field, ...]


class ServiceEventInfo(Message):
    """What each service's type contains besides its request and response; never sent here."""

    ROS_TYPE: ClassVar[str] = "service_msgs/msg/ServiceEventInfo"
    event_type: UInt8 = 0
    stamp: Time = Time()
    client_gid: Annotated[bytes, msgspec.Meta(min_length=16, max_length=16)] = bytes(16)
    sequence_number: int = 0


def dds_type(name: str) -> str:
    """Return the DDS name of a type: `geometry_msgs::msg::dds_::Twist_`."""
    package, space, own = name.split("/")
    return f"{package}::{space}::dds_::{own}_"


def definition(kind: type[Message]) -> str:
    """Return a message's definition with those it depends on, as MCAP's `ros2msg`.

    Raises:
        RosTypeError: ROS has no type for a field.
    """
    own, *others = parts(kind)
    titles = [f"{'=' * 80}\nMSG: {other.ROS_TYPE.replace('/msg/', '/')}\n" for other in others]
    texts = [own_definition(other) for other in others]
    return own_definition(own) + "".join(map("".join, zip(titles, texts, strict=True)))


def own_definition(kind: type[Message]) -> str:
    """Return what a message's `.msg` file holds."""
    lines = [*kind.ROS_CONSTANTS, *(field.text for field in fields(kind))]
    return "".join(f"{line}\n" for line in lines)


def parts(kind: type[Message]) -> tuple[type[Message], ...]:
    """Return a message's type, then all that it contains, each when it is first met."""
    found = {kind: None}
    for field in fields(kind):
        if field.kind is not None:
            found.update(dict.fromkeys(parts(field.kind)))
    return tuple(found)


@cache
def type_hash(kind: type[Message]) -> str:
    """Return the hash of a message's type, as from ROS 2 Iron on: `RIHS01_…` (REP-2016).

    Raises:
        RosTypeError: ROS has no type for a field.
    """
    return _hash(kind.ROS_TYPE, fields(kind))


@cache
def service_hash(name: str, request: type[Message], response: type[Message]) -> str:
    """Return the hash of a service's type, such as `std_srvs/srv/Trigger`.

    It is that of a message with the request, the response and the event that introspection
    publishes. The names of `request` and `response` don't matter, their fields do.

    Raises:
        RosTypeError: ROS has no type for a field.
    """
    asked, answered = f"{name}_Request", f"{name}_Response"
    event = (
        Field("info", ServiceEventInfo.ROS_TYPE, ServiceEventInfo),
        Field("request", asked, request, "[<={}]", 1),
        Field("response", answered, response, "[<={}]", 1),
    )
    members = (
        Field("request_message", asked, request),
        Field("response_message", answered, response),
        Field("event_message", f"{name}_Event"),
    )
    return _hash(name, members, {f"{name}_Event": event})


def _hash(name: str, own: _Fields, more: Mapping[str, _Fields] = MappingProxyType({})) -> str:
    """Return the SHA-256 of a type's description in JSON (rosidl's `calculate_type_hash`)."""
    known: dict[str, Any] = {}

    def describe(name: str, members: _Fields) -> dict[str, Any]:
        for field in members:
            if field.kind is not None and field.base not in known:
                known[field.base] = describe(field.base, fields(field.kind))
        shown = members or (Field("structure_needs_at_least_one_member", "uint8"),)
        return {"type_name": name, "fields": [field.description for field in shown]}

    for other, members in more.items():
        known[other] = describe(other, members)
    description = describe(name, own)
    referenced = [known[other] for other in sorted(known)]
    whole = {"type_description": description, "referenced_type_descriptions": referenced}
    text = msgspec.json.format(msgspec.json.encode(whole), indent=0)  # with rosidl's blanks
    return f"RIHS01_{sha256(text).hexdigest()}"
