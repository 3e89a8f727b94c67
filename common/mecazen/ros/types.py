"""ROS 2's view of the messages: field types, definitions, and the hashes of types and services.

The type of a field follows from its annotation: an integer takes the fewest of 8, 16, 32 or 64
bits that hold its bounds, `bytes` are `uint8[]`, and a tuple whose least and greatest lengths are
one is an array. `msgspec.Meta(extra={"ros": "byte"})` names a type that the bounds can't tell.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from hashlib import sha256
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, NamedTuple

import msgspec
import msgspec.inspect as mi

from mecazen.errors import MecazenError
from mecazen.messages import Message, Time, UInt8

FLOAT32_MAX = 3.4028234663852886e38

# ids of type_description_interfaces/msg/FieldType; an array of a type, a sequence of at most N and
# one of any length are numbered the same way, each 48 further
_IDS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8,
    "uint64": 9, "float32": 10, "float64": 11, "bool": 15, "byte": 16, "string": 17,
}  # fmt: skip
_NESTED_ID = 1
_SHAPE_IDS = {"": 0, "[{}]": 48, "[<={}]": 96, "[]": 144}

_SEPARATOR = "=" * 80


class RosTypeError(MecazenError):
    """A message with a field that ROS has no type for."""


class Field(NamedTuple):
    """A field of a message as ROS sees it."""

    name: str
    base: str
    """Of one item: `float64`, `string`, … or the name of a message."""
    kind: type[Message] | None = None
    """The struct of a message."""
    shape: str = ""
    """Empty for one item, else `[{}]`, `[<={}]` or `[]`; the brace stands for `length`."""
    length: int = 0
    node: mi.Type | None = None
    """The annotation of one item, with its bounds."""

    @property
    def text(self) -> str:
        """The field in a definition."""
        return f"{self.base.replace('/msg/', '/')}{self.shape.format(self.length)} {self.name}"

    @property
    def description(self) -> dict[str, Any]:
        """The field as type_description_interfaces/msg/Field."""
        nested = "/" in self.base
        kind = {
            "type_id": (_NESTED_ID if nested else _IDS[self.base]) + _SHAPE_IDS[self.shape],
            "capacity": self.length,
            "string_capacity": 0,
            "nested_type_name": self.base if nested else "",
        }
        return {"name": self.name, "type": kind}


_Fields = tuple[Field, ...]


class ServiceEventInfo(Message):
    """What each service's type contains besides its request and response; never sent here."""

    ROS_TYPE: ClassVar[str] = "service_msgs/msg/ServiceEventInfo"
    event_type: UInt8 = 0
    stamp: Time = Time()
    client_gid: Annotated[bytes, msgspec.Meta(min_length=16, max_length=16)] = bytes(16)
    sequence_number: int = 0


@cache
def fields(kind: type[Message]) -> _Fields:
    """Return the fields of a message in order.

    Raises:
        RosTypeError: ROS has no type for a field.
    """
    info = mi.type_info(kind)
    assert isinstance(info, mi.StructType)
    found = []
    for field in info.fields:
        try:
            found.append(_field(field.name, field.type))
        except KeyError as error:
            what = f"{kind.ROS_TYPE}: {field.name}: ROS has no type for {error.args[0]}"
            raise RosTypeError(what) from None
    return tuple(found)


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
    separated = (f"{_SEPARATOR}\nMSG: {k.ROS_TYPE.replace('/msg/', '/')}\n" for k in others)
    rest = (head + own_definition(k) for head, k in zip(separated, others, strict=True))
    return own_definition(own) + "".join(rest)


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
    text = json.dumps({"type_description": description, "referenced_type_descriptions": referenced})
    return f"RIHS01_{sha256(text.encode()).hexdigest()}"


def _field(name: str, node: mi.Type) -> Field:
    """Return a field; a KeyError holds the annotation that ROS has no type for."""
    extra = None
    if isinstance(node, mi.Metadata):
        extra, node = (node.extra or {}).get("ros"), node.type
    if isinstance(node, mi.VarTupleType | mi.BytesType):
        shape, length = "[]", 0
        if node.max_length is not None:
            shape = "[{}]" if node.min_length == node.max_length else "[<={}]"
            length = node.max_length
        if isinstance(node, mi.BytesType):
            return Field(name, extra or "uint8", None, shape, length, node)
        item = _field(name, node.item_type)
        if item.shape:
            raise KeyError("a sequence of sequences")
        return item._replace(shape=shape, length=length)
    if isinstance(node, mi.StructType) and issubclass(node.cls, Message):
        return Field(name, node.cls.ROS_TYPE, node.cls)
    return Field(name, extra or _primitive(node), node=node)


def _primitive(node: mi.Type) -> str:
    if isinstance(node, mi.IntType):
        low, high = bounds(node)
        for bits in (8, 16, 32, 64):
            for sign, least in (("u", 0), ("", -(2 ** (bits - 1)))):
                if low >= least and high < least + 2**bits:
                    return f"{sign}int{bits}"
        return "int64"
    if isinstance(node, mi.FloatType):
        return "float32" if node.le == FLOAT32_MAX else "float64"
    if isinstance(node, mi.StrType):
        return "string"
    if isinstance(node, mi.BoolType):
        return "bool"
    raise KeyError(type(node).__name__.removesuffix("Type").lower())


def bounds(node: mi.IntType | mi.FloatType) -> tuple[float, float]:
    """Return the least and the greatest value of a whole number; infinite where there is none."""
    low = node.ge if node.ge is not None else node.gt + 1 if node.gt is not None else -float("inf")
    high = node.le if node.le is not None else node.lt - 1 if node.lt is not None else float("inf")
    return low, high
