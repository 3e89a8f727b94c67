"""Names, fields, definitions and hashes of ROS 2's types, from the structs, by rosbags.

The type of a field follows from its annotation: an integer takes the fewest of 8, 16, 32 or 64
bits that hold its bounds, `bytes` are `uint8[]`, and a tuple whose least and greatest lengths are
equal is an array. `msgspec.Meta(extra={"ros": "byte"})` names a type that bounds can't.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Annotated, Any, ClassVar

import msgspec
import msgspec.inspect as mi
import numpy as np
from mecazen.errors import MecazenError
from mecazen.messages import Message, Time, UInt8
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

FLOAT32_MAX = 3.4028234663852886e38
NO_FIELD = "structure_needs_at_least_one_member"
"""The field that ROS gives a type without fields."""
STORE: Any = get_typestore(Stores.EMPTY)
"""rosbags' store of the types that were asked for so far."""

Shape = tuple[int, Any]
"""A type in rosbags' form: its `Nodetype` and details."""
ITEMS = (Nodetype.ARRAY, Nodetype.SEQUENCE)


class RosTypeError(MecazenError):
    """A message with a field that ROS has no type for."""


class ServiceEventInfo(Message):
    """The event in each service's type, besides request and response; never sent here."""

    ROS_TYPE: ClassVar[str] = "service_msgs/msg/ServiceEventInfo"
    event_type: UInt8 = 0
    stamp: Time = Time()
    client_gid: Annotated[bytes, msgspec.Meta(min_length=16, max_length=16)] = bytes(16)
    sequence_number: int = 0


@cache
def fields(kind: type[Message]) -> tuple[tuple[str, Shape], ...]:
    """Return the names and types of a message's fields; register nested messages as well.

    Raises:
        RosTypeError: ROS has no type for a field.
    """
    found = []
    for name, node in _annotations(kind):
        try:
            found.append((name, _shape(node)))
        except KeyError as error:
            what = f"{kind.ROS_TYPE}: {name}: ROS has no type for {error.args[0]}"
            raise RosTypeError(what) from None
    return tuple(found) or ((NO_FIELD, (Nodetype.BASE, ("uint8", 0))),)


def _shape(node: mi.Type) -> Shape:
    """Return the type of an annotation; a KeyError names a type that ROS lacks."""
    node, own = _without_metadata(node)
    if isinstance(node, mi.VarTupleType | mi.BytesType):
        item = _base(own or "uint8") if isinstance(node, mi.BytesType) else _shape(node.item_type)
        if item[0] in ITEMS:
            raise KeyError("a sequence of sequences")
        fixed = node.max_length is not None and node.min_length == node.max_length
        return Nodetype.ARRAY if fixed else Nodetype.SEQUENCE, (item, node.max_length or 0)
    if isinstance(node, mi.StructType) and issubclass(node.cls, Message):
        return Nodetype.NAME, known(node.cls)
    if isinstance(node, mi.StrType):
        return _base("string", node.max_length or 0)
    return _base(own or _number(node))


def _base(name: str, capacity: int = 0) -> Shape:
    return Nodetype.BASE, (name, capacity)


def _number(node: mi.Type) -> str:
    if isinstance(node, mi.IntType):
        low, high = _bounds(node)
        for bits in (8, 16, 32, 64):
            for sign, least in (("u", 0), ("", -(2 ** (bits - 1)))):
                if low >= least and high < least + 2**bits:
                    return f"{sign}int{bits}"
        return "uint64" if low >= 0 else "int64"
    if isinstance(node, mi.FloatType):
        return "float32" if node.le == FLOAT32_MAX else "float64"
    if isinstance(node, mi.BoolType):
        return "bool"
    raise KeyError(type(node).__name__.removesuffix("Type").lower())


def _bounds(node: mi.IntType) -> tuple[float, float]:
    """Return the least and the greatest value of a whole number; infinite if there is none."""
    low = node.ge if node.ge is not None else node.gt + 1 if node.gt is not None else -float("inf")
    high = node.le if node.le is not None else node.lt - 1 if node.lt is not None else float("inf")
    return low, high


@cache
def known(kind: type[Message]) -> str:
    """Return the name of a message's type, after registering its fields with rosbags.

    Raises:
        RosTypeError: ROS has no type for a field, or another message has this name.
    """
    _tell(kind.ROS_TYPE, fields(kind), [_constant(line) for line in kind.ROS_CONSTANTS])
    STORE.types[kind.ROS_TYPE] = _made_by(kind)
    return kind.ROS_TYPE


def _made_by(kind: type[Message]) -> Any:
    """Return the function that rosbags calls with a message's fields to get them as in JSON."""
    names = kind.__struct_fields__
    nodes = [_without_metadata(node)[0] for _, node in _annotations(kind)]
    turns: list[Any] = [
        np.ndarray.tobytes if isinstance(n, mi.BytesType) else np.ndarray.tolist for n in nodes
    ]

    def made(*values: Any) -> dict[str, Any]:
        given = zip(names, turns, values, strict=False)  # drops the placeholder field
        return {
            name: turn(value) if isinstance(value, np.ndarray) else value
            for name, turn, value in given
        }

    return made


def _annotations(kind: type[Any]) -> list[tuple[str, mi.Type]]:
    info = mi.type_info(kind)
    assert isinstance(info, mi.StructType)
    return [(field.name, field.type) for field in info.fields]


def _without_metadata(node: mi.Type) -> tuple[mi.Type, str | None]:
    """Return an annotation, and the type in ROS that it names."""
    if isinstance(node, mi.Metadata):
        return node.type, (node.extra or {}).get("ros")
    return node, None


def _constant(line: str) -> tuple[str, str, Any]:
    base, _, rest = line.partition(" ")
    name, _, value = rest.partition("=")
    return name, base, int(value)


def _tell(name: str, members: Iterable[tuple[str, Shape]], constants: Iterable[Any] = ()) -> None:
    told = [*members]
    if STORE.fielddefs.setdefault(name, ([*constants], told))[1] != told:
        raise RosTypeError(f"{name}: another message of this name has other fields")


def parts(kind: type[Message]) -> tuple[type[Message], ...]:
    """Return a message's type, then all types in it, each once, in the order of first use."""
    found = {kind: None}
    for _, annotation in _annotations(kind):
        node, _ = _without_metadata(annotation)
        if isinstance(node, mi.VarTupleType):
            node, _ = _without_metadata(node.item_type)
        if isinstance(node, mi.StructType) and issubclass(node.cls, Message):
            found.update(dict.fromkeys(parts(node.cls)))
    return tuple(found)


def definition(kind: type[Message]) -> str:
    """Return a message's definition with those it depends on, as MCAP's `ros2msg`.

    Raises:
        RosTypeError: ROS has no type for a field.
    """
    text: str = STORE.generate_msgdef(known(kind), ros_version=2)[0]
    return text


def type_hash(kind: type[Message]) -> str:
    """Return the hash of a message's type, as from ROS 2 Iron on: `RIHS01_…` (REP-2016).

    Raises:
        RosTypeError: ROS has no type for a field.
    """
    return _hash(known(kind))


@cache
def service_hash(name: str, request: type[Message], response: type[Message]) -> str:
    """Return the hash of a service's type, such as `std_srvs/srv/Trigger`.

    The hash is that of a message with the request, the response and the event that introspection
    publishes. The fields of `request` and `response` matter, not their names.

    Raises:
        RosTypeError: ROS has no type for a field.
    """
    asked, answered, event = (f"{name}_{part}" for part in ("Request", "Response", "Event"))
    _tell(asked, fields(request))
    _tell(answered, fields(response))
    parts = (Nodetype.NAME, asked), (Nodetype.NAME, answered)
    info = Nodetype.NAME, known(ServiceEventInfo)
    most_one = [(Nodetype.SEQUENCE, (part, 1)) for part in parts]
    _tell(event, zip(("info", "request", "response"), (info, *most_one), strict=True))
    names = ("request_message", "response_message", "event_message")
    _tell(name, zip(names, (*parts, (Nodetype.NAME, event)), strict=True))
    return _hash(name)


def _hash(name: str) -> str:
    hashed: str = STORE.hash_rihs01(name)
    return hashed
