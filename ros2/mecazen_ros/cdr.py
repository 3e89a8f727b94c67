"""Messages in ROS 2's CDR (XCDR1): a header of four bytes, then fields aligned to their size.

rosbags decodes. What is published every tick takes it too long to encode (docs/performance.md), so
`encode` packs a whole message by one `struct.Struct`, which other messages with the same lengths
share.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import cache, lru_cache
from operator import attrgetter
from typing import Any, NamedTuple

import msgspec
from mecazen.errors import RefusedError
from mecazen.messages import Message, MessageT
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError

from mecazen_ros.types import NO_FIELD, STORE, RosTypeError, Shape, known

HEADER = b"\x00\x01\x00\x00"
"""Little-endian, no padding at the end."""
CODES = {
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float32": "f", "float64": "d", "bool": "?", "byte": "B",
}  # fmt: skip
SIZES = {code: struct.calcsize(f"<{code}") for code in (*CODES.values(), "s", "x")}
BYTES = ("uint8", "byte")
LAYOUTS = 256
"""Number of layouts, and of lists of texts, that are kept."""

Add = Callable[[Any, list[Any], list[int]], None]
"""Adds a field to the values to pack, and its length to those that the layout depends on."""


class _Plan(NamedTuple):
    """How the values of a type's messages are gathered."""

    get: Callable[[Message], tuple[Any, ...]]
    """Returns the fields, also of messages within."""
    runs: tuple[tuple[Add | None, int, int], ...]
    """What adds the fields from one place to another; None for numbers, which need nothing."""


def encode(message: Message) -> bytes:
    """Return a message in CDR; its bounds are not checked.

    Raises:
        RefusedError: A number does not fit into its type, or a text has no UTF-8.
        RosTypeError: ROS has no type for a field.
    """
    kind = type(message)
    values: list[Any] = [HEADER]
    lengths: list[int] = []
    try:
        _add_message(message, values, lengths)
        return _layout(known(kind), tuple(lengths)).pack(*values)
    except (struct.error, OverflowError, UnicodeEncodeError) as error:
        raise RefusedError(f"no {kind.ROS_TYPE} in CDR: {error}") from None


def decode(payload: bytes, kind: type[MessageT]) -> MessageT:
    """Return the message in `payload`, of either byte order.

    Raises:
        RefusedError: Truncated, too long, of another encoding, or a value out of its bounds; or
            ROS has no type for a field of such a message.
    """
    try:
        fields = STORE.deserialize_cdr(payload, known(kind))
        return msgspec.convert(fields, kind, builtin_types=(bytes,))
    except (SerdeError, msgspec.ValidationError, RosTypeError) as error:
        raise RefusedError(f"not a {kind.ROS_TYPE}: {error}") from None


def _add_message(message: Message, values: list[Any], lengths: list[int]) -> None:
    get, runs = _plan(type(message))
    got = get(message)
    for add, begin, end in runs:
        if add is None:
            values += got[begin:end]
        else:
            add(got[begin], values, lengths)


@cache
def _plan(kind: type[Message]) -> _Plan:
    leaves = dict(_leaves(known(kind), ""))
    runs: list[tuple[Add | None, int, int]] = []
    for at, add in enumerate(leaves.values()):
        if add is None and runs and runs[-1][0] is None:
            runs[-1] = None, runs[-1][1], at + 1
        else:
            runs.append((add, at, at + 1))
    # with one path more than needed, what is got is always a tuple
    return _Plan(attrgetter(*leaves, "ROS_TYPE"), tuple(runs))


def _leaves(name: str, path: str) -> Iterator[tuple[str, Add | None]]:
    for field, (node, detail) in STORE.fielddefs[name][1]:
        if node == Nodetype.NAME:
            yield from _leaves(detail, f"{path}{field}.")
        elif node == Nodetype.BASE and detail[0] != "string":
            if field != NO_FIELD:
                yield path + field, None
        elif node == Nodetype.BASE:
            yield path + field, _add_text
        else:
            add = _ADDS.get(_item(detail[0]), _add_numbers)
            yield path + field, _without_count(add) if node == Nodetype.ARRAY else add


def _item(shape: Shape) -> str:
    """Return the primitive type of a list's items; empty where they are messages."""
    return "" if shape[0] == Nodetype.NAME else shape[1][0]


def _add_text(text: str, values: list[Any], lengths: list[int]) -> None:
    data = text.encode()
    lengths.append(len(data) + 1)  # and a zero
    values += (len(data) + 1, data)


def _add_texts(texts: tuple[str, ...], values: list[Any], lengths: list[int]) -> None:
    data = _packed(texts)
    lengths.append(len(data))
    values += (len(texts), data)


def _add_bytes(data: bytes, values: list[Any], lengths: list[int]) -> None:
    lengths.append(len(data))
    values += (len(data), bytes(data))


def _add_numbers(numbers: tuple[float, ...], values: list[Any], lengths: list[int]) -> None:
    lengths.append(len(numbers))
    values.append(len(numbers))
    values += numbers


def _add_messages(messages: tuple[Message, ...], values: list[Any], lengths: list[int]) -> None:
    lengths.append(len(messages))
    values.append(len(messages))
    for message in messages:
        _add_message(message, values, lengths)


_ADDS: dict[str, Add] = {
    "": _add_messages, "string": _add_texts, "uint8": _add_bytes, "byte": _add_bytes,
}  # fmt: skip
"""What adds a list, by the type of its items; all others are numbers."""


def _without_count(add: Add) -> Add:
    """Return what adds an array: its type has the number of items, not its bytes."""

    def add_array(array: Any, values: list[Any], lengths: list[int]) -> None:
        count = len(values)
        add(array, values, lengths)
        del values[count]

    return add_array


@lru_cache(maxsize=LAYOUTS)
def _packed(texts: tuple[str, ...]) -> bytes:
    """Return texts, each at a multiple of 4."""
    out = bytearray()
    for text in texts:
        data = text.encode()
        out += bytes(-len(out) % 4) + struct.pack("<I", len(data) + 1) + data + b"\x00"
    return bytes(out)


@lru_cache(maxsize=LAYOUTS)
def _layout(name: str, lengths: tuple[int, ...]) -> struct.Struct:
    """Return the layout of a type's messages that have these lengths."""
    rest, text, at = iter(lengths), ["<4s"], 0

    def put(code: str, count: int = 1) -> None:
        nonlocal at
        pad = -at % SIZES[code]
        text.append(f"{pad}x{count}{code}")
        at += pad + count * SIZES[code]

    def put_field(node: int, detail: Any) -> None:
        if node == Nodetype.NAME:
            for field, shape in STORE.fielddefs[detail][1]:
                put("x") if field == NO_FIELD else put_field(*shape)
        elif node == Nodetype.BASE and detail[0] == "string":
            put("I")
            put("s", next(rest))
        elif node == Nodetype.BASE:
            put(CODES[detail[0]])
        else:
            put_items(node, *detail)

    def put_items(node: int, shape: Shape, expected: int) -> None:
        item, count = _item(shape), next(rest)
        if node == Nodetype.SEQUENCE:
            put("I")
        elif item != "string" and count != expected:
            raise struct.error(f"{count} items in an array of {expected}")
        if item == "string":
            put("I", 0)  # to a multiple of 4
        if item == "string" or item in BYTES:
            put("s", count)
        elif not item:
            for _ in range(count):
                put_field(*shape)
        elif count:
            put(CODES[item], count)

    put_field(Nodetype.NAME, name)
    return struct.Struct("".join(text))
