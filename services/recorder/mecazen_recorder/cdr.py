"""Messages in ROS 2's CDR, and their definitions in ROS's interface language.

ROS's types come from rosbags; those of `mecazen_msgs` are generated from the structs. ROS has
no optional values, and no message on a key has any.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache
from typing import Any

import msgspec
import msgspec.inspect as mi
import numpy as np
from mecazen.keys import MessageT
from mecazen.messages import Message
from mecazen.wire import RefusedError
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

_STORE = get_typestore(Stores.ROS2_JAZZY)


def encode(message: Message) -> bytes:
    """Return a message in little-endian CDR, with ROS 2's header of four bytes."""
    name = _known(type(message))
    convert = _to_ros(name)
    ros = message if convert is None else convert(message)
    return bytes(_STORE.serialize_cdr(ros, name, little_endian=True))


def decode(payload: bytes, kind: type[MessageT]) -> MessageT:
    """Return the message in `payload`.

    Raises:
        RefusedError: The payload is not the CDR of such a message.
    """
    try:
        return msgspec.convert(_plain(_STORE.deserialize_cdr(payload, _known(kind))), kind)
    except (SerdeError, msgspec.ValidationError) as error:
        raise RefusedError(f"not a {kind.ROS_TYPE}: {error}") from None


def definition(kind: type[Message]) -> str:
    """Return a message's definition with its dependencies, as MCAP's `ros2msg`."""
    return _STORE.generate_msgdef(_known(kind), ros_version=2)[0]


@cache
def _known(kind: type[Message]) -> str:
    """Return the ROS type of a message; register it in the type store if it is ours."""
    name = kind.ROS_TYPE
    if name not in _STORE.fielddefs:
        fields = msgspec.structs.fields(kind)
        lines = [f"{_ros_type(mi.type_info(field.type))} {field.name}" for field in fields]
        _STORE.register(get_types_from_msg("\n".join(lines), name))
    return name


def _ros_type(node: mi.Type) -> str:
    if isinstance(node, mi.StructType):
        return _known(node.cls).replace("/msg/", "/")
    if isinstance(node, mi.VarTupleType):
        return f"{_ros_type(node.item_type)}[]"
    if isinstance(node, mi.IntType):
        sign = "u" if node.ge is not None and node.ge >= 0 else ""
        return f"{sign}int{32 if node.le is not None and node.le < 2**32 else 64}"
    return {mi.FloatType: "float64", mi.StrType: "string", mi.BoolType: "bool"}[type(node)]


@cache
def _to_ros(name: str) -> Callable[[Any], Any] | None:
    """Return the conversion of a struct for the serialiser; None if it needs none.

    The serialiser reads attributes by name, and needs sequences of numbers as arrays.
    """
    conversions = {
        field: convert
        for field, desc in _STORE.fielddefs[name][1]
        if (convert := _field_to_ros(desc)) is not None
    }
    if not conversions:
        return None
    fields = [field for field, _ in _STORE.fielddefs[name][1]]
    kind = _STORE.types[name]

    def convert_message(message: Any) -> Any:
        values = {field: getattr(message, field) for field in fields}
        for field, convert in conversions.items():
            values[field] = convert(values[field])
        return kind(**values)

    return convert_message


def _field_to_ros(desc: Any) -> Callable[[Any], Any] | None:
    node, detail = desc
    if node == Nodetype.NAME:
        return _to_ros(detail)
    if node == Nodetype.BASE:
        return None
    item, item_detail = detail[0]
    if item == Nodetype.BASE:
        kind = item_detail[0]
        if kind == "uint8":  # bytes
            return lambda values: np.frombuffer(values, dtype=kind)
        return None if kind == "string" else lambda values: np.array(values, dtype=kind)
    convert = _to_ros(item_detail)
    return None if convert is None else lambda values: [convert(value) for value in values]


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tobytes() if value.dtype == np.uint8 else value.tolist()
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if dataclasses.is_dataclass(value):
        return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    return value
