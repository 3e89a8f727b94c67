"""Messages in ROS 2's CDR (XCDR1), encoded and decoded by rosbags."""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Callable
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
from mecazen.errors import RefusedError
from mecazen.messages import JointState, LaserScan, Message, MessageT, Twist, finite_scan
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError

from mecazen_ros.types import NO_FIELD, STORE, RosTypeError, Shape, registered

HEADER = bytes((0, sys.byteorder == "little", 0, 0))
"""Header of encoded messages: the machine's byte order, and no padding at the end."""


def _finite_joints(fields: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a JointState without lists with NaN: ROS 2's broadcaster sends those."""
    lists = ("position", "velocity", "effort")
    return fields | {name: [] for name in lists if not all(map(math.isfinite, fields[name]))}


FINITE: dict[type[Message], Callable[[dict[str, Any]], dict[str, Any]]] = {
    LaserScan: finite_scan,
    JointState: _finite_joints,
}
"""Messages in which drivers of ROS send NaN or infinity, and what replaces them."""


def encode(message: Message) -> bytes:
    """Return a message in CDR; the bounds of its fields are not checked.

    Raises:
        RefusedError: A whole number does not fit into its type, or a text has no UTF-8.
    """
    name = registered(type(message))
    try:
        return bytes(STORE.serialize_cdr(_with_arrays(message, name), name))
    except (SerdeError, struct.error, OverflowError, UnicodeEncodeError) as error:
        raise RefusedError(f"no {name} in CDR: {error}") from None


def decode(payload: bytes, kind: type[MessageT]) -> MessageT:
    """Return the message in `payload`, of either byte order.

    A payload that is no Twist may be a TwistStamped, which is longer.

    Raises:
        RefusedError: Truncated, too long, of another encoding, or a value out of its bounds.
    """
    try:
        fields = _fields_of(payload, kind)
        try:
            return msgspec.convert(fields, kind, builtin_types=(bytes,))
        except msgspec.ValidationError:
            if kind not in FINITE:
                raise
            return msgspec.convert(FINITE[kind](fields), kind)
    except (SerdeError, msgspec.ValidationError, RosTypeError) as error:
        raise RefusedError(f"not a {kind.ROS_TYPE}: {error}") from None


def _fields_of(payload: bytes, kind: type[Message]) -> dict[str, Any]:
    try:
        fields: dict[str, Any] = STORE.deserialize_cdr(payload, registered(kind))
    except SerdeError:
        if kind is not Twist:
            raise
        fields = STORE.deserialize_cdr(payload, "geometry_msgs/msg/TwistStamped")["twist"]
    return fields


def _with_arrays(message: Message, name: str) -> Any:
    """Return the fields of a message of a type as rosbags encodes them, with arrays of numbers."""
    converters = _converters(name)
    if not converters:
        return message
    values = {field: getattr(message, field, 0) for field in dict(STORE.fielddefs[name][1])}
    values |= {field: convert(values[field]) for field, convert in converters.items()}
    return SimpleNamespace(**values)


@cache
def _converters(name: str) -> dict[str, Callable[[Any], Any]]:
    """Return functions for the fields of a type that rosbags takes in another form."""
    fields = STORE.fielddefs[name][1]
    converters = {field: int if field == NO_FIELD else _converter(shape) for field, shape in fields}
    return {field: convert for field, convert in converters.items() if convert is not None}


def _converter(shape: Shape) -> Callable[[Any], Any] | None:
    node, detail = shape
    if node == Nodetype.NAME:
        return partial(_with_arrays, name=detail) if _converters(detail) else None
    if node == Nodetype.BASE:
        return None
    item_node, item = detail[0]
    if item_node == Nodetype.NAME:
        return lambda parts: [_with_arrays(part, item) for part in parts]
    if item[0] in ("uint8", "byte"):
        return partial(np.frombuffer, dtype="uint8")
    return None if item[0] == "string" else partial(np.array, dtype=item[0])
