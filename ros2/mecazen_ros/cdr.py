"""Messages in ROS 2's CDR (XCDR1): a header of four bytes, then fields aligned to their size.

rosbags decodes messages. Its encoder is too slow for the messages of every tick: 73 µs where
`encode` takes 34. So `encode` packs a whole message by `struct`, whose native
alignment is CDR's.
"""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache, lru_cache, partial
from operator import attrgetter
from typing import Any

import msgspec
from mecazen.errors import RefusedError
from mecazen.messages import JointState, LaserScan, Message, MessageT, Twist, finite_scan
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError

from mecazen_ros.types import NO_FIELD, STORE, RosTypeError, Shape, registered

HEADER = bytes((0, sys.byteorder == "little", 0, 0))
"""Header of encoded messages: the machine's byte order, and no padding at the end."""
CODES = {
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float32": "f", "float64": "d", "bool": "?", "byte": "B",
}  # fmt: skip


def _finite_joints(fields: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a JointState without lists with NaN: ROS 2's broadcaster sends those."""
    lists = ("position", "velocity", "effort")
    return fields | {name: [] for name in lists if not all(map(math.isfinite, fields[name]))}


FINITE: dict[type[Message], Callable[[dict[str, Any]], dict[str, Any]]] = {
    LaserScan: finite_scan,
    JointState: _finite_joints,
}
"""Messages in which drivers of ROS send NaN or infinity, and what replaces them."""
Add = Callable[[Any, list[Any]], str]
"""Adds a field to the values to pack, and returns its format."""


def encode(message: Message) -> bytes:
    """Return a message in CDR; the bounds of its fields are not checked.

    Raises:
        RefusedError: A whole number does not fit into its type, or a text has no UTF-8.
    """
    values: list[Any] = []
    try:
        return HEADER + struct.pack(_add_message(message, values), *values)
    except (struct.error, UnicodeEncodeError) as error:
        raise RefusedError(f"no {message.ROS_TYPE} in CDR: {error}") from None


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


def _add_message(message: Message, values: list[Any]) -> str:
    get, steps = _plan(type(message))
    formats = []
    for value, step in zip(get(message), steps, strict=False):
        if isinstance(step, str):
            values.append(value)
            formats.append(step)
        else:
            formats.append(step(value, values))
    return "".join(formats)


@cache
def _plan(kind: type[Message]) -> tuple[Callable[[Message], tuple[Any, ...]], list[Add | str]]:
    """Return the getter of a message's fields, also of nested ones, and how to add each."""
    paths, steps = zip(*_steps(registered(kind), ""), strict=True)
    return attrgetter(*paths, "ROS_TYPE"), list(steps)  # with two paths `get` returns a tuple


def _steps(name: str, path: str) -> Iterator[tuple[str, Add | str]]:
    """Yield the path to each field of a type, and its format or the function that adds it."""
    for field, (node, detail) in STORE.fielddefs[name][1]:
        if node == Nodetype.NAME:
            yield from _steps(detail, f"{path}{field}.")
        elif field == NO_FIELD:
            yield f"{path}ROS_TYPE", lambda *_: "x"
        elif node == Nodetype.BASE:
            yield path + field, CODES.get(detail[0], _add_text)
        elif node == Nodetype.ARRAY:
            yield path + field, _list_adder(*detail)
        else:
            yield path + field, partial(_add_counted, _list_adder(detail[0]))


def _list_adder(item: Shape, length: int | None = None) -> Add:
    """Return the function that adds the items of a list; an array has a fixed length."""
    node, detail = item
    if node == Nodetype.NAME:
        return lambda items, values: "".join([_add_message(item, values) for item in items])
    if detail[0] == "string":
        return _add_texts
    if detail[0] in ("uint8", "byte"):
        return _add_bytes
    return partial(_add_numbers, CODES[detail[0]], length)


def _add_counted(add: Add, items: Sequence[Any], values: list[Any]) -> str:
    values.append(len(items))
    return "I" + add(items, values)


def _add_text(text: str, values: list[Any]) -> str:
    data = text.encode()
    values += (len(data) + 1, data)
    return f"I{len(data) + 1}s"  # with a final zero


def _add_texts(texts: Sequence[str], values: list[Any]) -> str:
    data = _packed(tuple(texts))
    values.append(data)
    return f"0I{len(data)}s"


@lru_cache(maxsize=256)
def _packed(texts: tuple[str, ...]) -> bytes:
    """Return encoded texts, each aligned to 4 bytes."""
    values: list[Any] = []
    return struct.pack("".join([_add_text(text, values) for text in texts]), *values)


def _add_bytes(data: bytes, values: list[Any]) -> str:
    values.append(data)
    return f"{len(data)}s"


def _add_numbers(code: str, length: int | None, numbers: Sequence[float], values: list[Any]) -> str:
    values += numbers
    count = len(numbers) if length is None else length
    return f"{count}{code}" if count else ""  # a list without items is not aligned
