"""Messages in ROS 2's CDR (XCDR1): a header of four bytes, then fields aligned to their size.

Both directions are functions that are generated once a type from its fields. They pack and unpack
all between two lists of messages or of texts at once, in layouts that are cached by the lengths in
them. What they write is little-endian; they read both byte orders.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache, lru_cache
from itertools import count
from math import hypot
from typing import Any, TypeVar, cast

import msgspec
import msgspec.inspect as mi

from mecazen.errors import RefusedError
from mecazen.messages import Message
from mecazen.ros.fields import FLOAT32_MAX, Field, RosTypeError, bounds, fields

MessageT = TypeVar("MessageT", bound=Message)

HEADER = b"\x00\x01\x00\x00"
"""Of what is written: little-endian, no padding at the end."""
MAX_PADDING = 3

_HEADERS = {bytes((0, i, 0, n)): order for i, order in enumerate("><") for n in range(4)}
"""The byte order of each header that is read; its last byte counts padding at the end."""
_CODES = {
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float32": "f", "float64": "d", "bool": "?", "byte": "B",
}  # fmt: skip
_SIZES = {code: struct.calcsize(f"<{code}") for code in _CODES.values()} | {"s": 1}
_FLOATS = "fd"
_LARGE = 1e300
"""Numbers whose hypotenuse is below are finite, and within every bound that is no narrower."""
_LAYOUTS = 256
"""So many lengths of what a message contains are remembered, for each place in it."""

_Pieces = list[tuple[str, int | None]]
"""Struct codes with how many of each; None where the message says how many."""


def encode(message: Message) -> bytes:
    """Return a message in CDR. As in JSON, nothing is checked that has to be a message's anyway.

    Raises:
        RefusedError: A number does not fit into its type, or a text has no UTF-8.
        RosTypeError: ROS has no type for a field.
    """
    kind = type(message)
    try:
        return _encoder(kind)(message)
    except (struct.error, OverflowError, UnicodeEncodeError) as error:
        raise RefusedError(f"no {kind.ROS_TYPE} in CDR: {error}") from None


def decode(payload: bytes, kind: type[MessageT], *, finite: bool = True) -> MessageT:
    """Return the message in `payload`.

    Args:
        payload: The bytes as they came.
        kind: The type of the message.
        finite: Whether to refuse NaN and infinity, as in JSON; REP-117 has them in scans.

    Raises:
        RefusedError: Truncated, too long, of another encoding, or a value out of its bounds; or
            ROS has no type for a field of such a message.
    """
    order = _HEADERS.get(payload[:4])
    if order is None:
        raise RefusedError(f"not a {kind.ROS_TYPE}: no header of CDR")
    try:
        message: MessageT = _decoder(kind, order, finite)(payload)
    except (struct.error, IndexError, ValueError, msgspec.ValidationError, RosTypeError) as error:
        raise RefusedError(f"not a {kind.ROS_TYPE}: {error}") from None
    return message


@cache
def _encoder(kind: type[Message]) -> Callable[[Any], bytes]:
    return _Encoder(kind).function


@cache
def _decoder(kind: type[Message], order: str, finite: bool) -> Callable[[bytes], Any]:
    return _Decoder(kind, order, finite).function


def _layout(order: str, pieces: _Pieces) -> Callable[..., struct.Struct]:
    """Return what gives the layout of `pieces` from an offset (modulo 8) and the open lengths."""

    @lru_cache(maxsize=_LAYOUTS)
    def layout(at: int, *lengths: int) -> struct.Struct:
        rest = iter(lengths)
        text = order
        for code, fixed in pieces:
            length = next(rest) if fixed is None else fixed
            if length or code == "s":  # a list without items is not aligned
                pad = (4 - at) % _SIZES[code]  # counted after the header
                text += f"{pad}x{length}{code}"
                at += pad + length * _SIZES[code]
        return struct.Struct(text)

    return layout


class _Writer:
    """Lines of a function, and the names in it."""

    def __init__(self, argument: str) -> None:
        self._lines = [f"def function({argument}):"]
        self._depth = 1
        self._numbers = count()
        self._names: dict[str, Any] = {"hypot": hypot}
        self._pieces: _Pieces = []

    def line(self, text: str) -> None:
        self._lines.append("    " * self._depth + text)

    def new(self, value: Any = None) -> str:
        """Return a new name; it stands for `value` if that is given."""
        name = f"n{next(self._numbers)}"
        if value is not None:
            self._names[name] = value
        return name

    def build(self) -> Callable[[Any], Any]:
        exec("\n".join(self._lines), self._names)  # noqa: S102  # made of names of fields alone
        return cast(Callable[[Any], Any], self._names["function"])


class _Encoder(_Writer):
    """Writes the function that encodes a type.

    `out` are the parts so far and `at` is their length, once there are any.
    """

    def __init__(self, kind: type[Message]) -> None:
        super().__init__("message")
        self._pieces = [("s", len(HEADER))]
        self._arguments = [self.new(HEADER)]
        self._lengths: list[str] = []
        self._has_parts = False
        self._message(kind, "message")
        if self._has_parts:
            self._flush()
            self.line("return b''.join(out)")
        else:
            self.line(f"return {self._packed()}")
        self.function = self.build()

    def _message(self, kind: type[Message], name: str) -> None:
        members = fields(kind)
        if not members:
            self._add("B", 1, "0")
        for field in members:
            self._field(field, f"{name}.{field.name}")

    def _field(self, field: Field, value: str) -> None:
        if field.shape in ("[]", "[<={}]"):
            value = self._named(value)
            length = self._named(f"len({value})")
            self._add("I", 1, length)
            self._items(field, value, None, length)
        elif field.shape:
            self._items(field, value, field.length, "")
        else:
            self._one(field, value)

    def _one(self, field: Field, value: str) -> None:
        if field.kind is not None:
            self._message(field.kind, self._named(value))
        elif field.base == "string":
            text = self._named(f"{value}.encode()")
            length = self._named(f"len({text}) + 1")  # and a zero
            self._add("I", 1, length)
            self._add("s", None, text, length)
        else:
            self._add(_CODES[field.base], 1, value)

    def _items(self, field: Field, value: str, fixed: int | None, length: str) -> None:
        if isinstance(field.node, mi.BytesType):
            self._add("s", fixed, value, length)
        elif field.base in _CODES:
            self._add(_CODES[field.base], fixed, f"*{value}", length)
        elif field.kind is None:
            self._flush()
            self.line(f"out.append({self.new(_texts)}(tuple({value})))")
            self.line("at += len(out[-1])")
        else:
            self._flush()
            item = self.new()
            self.line(f"for {item} in {value}:")
            self._depth += 1
            self._message(field.kind, item)
            self._flush()
            self._depth -= 1

    def _add(self, code: str, fixed: int | None, argument: str, length: str = "") -> None:
        self._pieces.append((code, fixed))
        self._arguments.append(argument)
        if fixed is None:
            self._lengths.append(length)

    def _named(self, value: str) -> str:
        name = self.new()
        self.line(f"{name} = {value}")
        return name

    def _packed(self) -> str:
        """Return the expression that packs what was added since the last time."""
        layout = _layout("<", self._pieces)
        if self._has_parts:
            pack = f"{self.new(layout)}({', '.join(['at & 7', *self._lengths])}).pack"
        elif self._lengths:
            pack = f"{self.new(layout)}({', '.join(['0', *self._lengths])}).pack"
        else:
            pack = self.new(layout(0).pack)
        arguments = ", ".join(self._arguments)
        self._pieces, self._arguments, self._lengths = [], [], []
        return f"{pack}({arguments})"

    def _flush(self) -> None:
        if not self._pieces:
            return
        packed = self._packed()
        if self._has_parts:
            self.line(f"out.append({packed})")
            self.line("at += len(out[-1])")
        else:
            self.line(f"out = [{packed}]")
            self.line("at = len(out[0])")
            self._has_parts = True


class _Decoder(_Writer):
    """Writes the function that decodes a type.

    Expressions for the values of fixed size are given before the line that unpacks them is
    written, when the next of another size begins. `at` is the offset in `data` of what is next;
    `_at` is the same while it is known.
    """

    def __init__(self, kind: type[Message], order: str, finite: bool) -> None:
        super().__init__("data")
        self._order, self._finite = order, finite
        self._at: int | None = len(HEADER)
        self._run = self.new()
        self._taken = 0
        self._conditions: list[str] = []
        self.line("valid = True")
        message = self._message(kind)
        self._flush()
        self._locate()
        self.line(f"if at != len(data): {self.new(_check_end)}(data, at)")
        self.line(f"message = {message}")
        self.line(f"return message if valid else {self.new(_validated)}(message)")
        self.function = self.build()

    def _message(self, kind: type[Message]) -> str:
        members = fields(kind)
        if not members:
            self._take("B", 1)
        values = ", ".join([self._value(field) for field in members])
        return f"{self.new(kind)}({values})"

    def _value(self, field: Field) -> str:
        """Return the expression of a field's value."""
        if field.shape:
            return self._items(field)
        if field.kind is not None:
            return self._message(field.kind)
        if field.base == "string":
            length = self._length()
            text = self.new()
            self.line(f"{text} = data[at:at + {length} - 1].decode(); at += {length}")
            self.line("if data[at - 1]: raise ValueError('a text without its end')")
            if field.capacity:
                self.line(f"valid = valid and len({text}) <= {field.capacity}")
            return text
        value = self._take(_CODES[field.base], 1)
        self._check(field, value, "{low} <= {value} <= {high}")
        return value

    def _items(self, field: Field) -> str:
        length = str(field.length)
        if field.shape != "[{}]":
            length = self._length()
            if field.length:
                self.line(f"if {length} > {field.length}: raise ValueError('too many items')")
        if isinstance(field.node, mi.BytesType):
            self._flush()
            self._locate()
            value = self.new()
            self.line(f"{value} = data[at:at + {length}]; at += {length}")
            return value
        if field.base not in _CODES:
            self._flush()
            self._locate()
            return self._strings(length) if field.kind is None else self._messages(field, length)
        all_within = "(not {value} or {low} <= min({value}) and max({value}) <= {high})"
        if field.shape == "[{}]":
            value = self._take(_CODES[field.base], field.length)
            self._check(field, value, all_within)
        else:
            value = self._sequence(_CODES[field.base], length)
            self._check(field, value, all_within)
            self._require()
        return value

    def _sequence(self, code: str, length: str) -> str:
        layout, value = self.new(), self.new()
        made = self.new(_layout(self._order, [(code, None)]))
        self.line(f"{layout} = {made}(at & 7, {length})")
        self.line(f"{value} = {layout}.unpack_from(data, at); at += {layout}.size")
        if code in _FLOATS and self._finite:
            self._conditions.append(f"hypot(*{value}) < {_LARGE}")
        return value

    def _strings(self, length: str) -> str:
        value = self.new()
        self.line(f"{value}, at = {self.new(_TextsReader(self._order))}(data, at, {length})")
        return value

    def _messages(self, field: Field, length: str) -> str:
        assert field.kind is not None
        value, add = self.new(), self.new()
        self.line(f"{value} = []; {add} = {value}.append")
        self.line(f"for _ in range({length}):")
        self._depth += 1
        message = self._message(field.kind)
        self._flush()
        self.line(f"{add}({message})")
        self._depth -= 1
        return f"tuple({value})"

    def _take(self, code: str, number: int) -> str:
        """Return the expression of values that are unpacked with others of fixed size."""
        begin = self._taken
        self._pieces.append((code, number))
        self._taken += number
        place = f"{begin}" if number == 1 else f"{begin}:{begin + number}"
        return f"{self._run}[{place}]"

    def _length(self) -> str:
        """Return the expression of a length that comes next; `at` is behind it then."""
        length = self._take("I", 1)
        self._flush()
        self._locate()
        return length

    def _locate(self) -> None:
        if self._at is not None:
            self.line(f"at = {self._at}")
            self._at = None

    def _flush(self) -> None:
        if not self._pieces:
            return
        layout = _layout(self._order, self._pieces)
        if self._at is not None:
            unpack = self.new(layout(self._at & 7).unpack_from)
            self.line(f"{self._run} = {unpack}(data, {self._at})")
            self._at += layout(self._at & 7).size
        else:
            layouts, one = self.new([layout(at) for at in range(8)]), self.new()
            self.line(f"{one} = {layouts}[at & 7]")
            self.line(f"{self._run} = {one}.unpack_from(data, at); at += {one}.size")
        if self._finite and any(code in _FLOATS for code, _ in self._pieces):
            self._conditions.append(f"hypot(*{self._run}) < {_LARGE}")
        self._require()
        self._pieces, self._taken, self._run = [], 0, self.new()

    def _require(self) -> None:
        """Write the conditions on what is unpacked by now."""
        if self._conditions:
            self.line(f"valid = valid and {' and '.join(self._conditions)}")
            self._conditions = []

    def _check(self, field: Field, value: str, condition: str) -> None:
        """Check bounds that are narrower than the type's own, once `value` is unpacked."""
        if not isinstance(field.node, mi.IntType | mi.FloatType):
            return
        low, high = bounds(field.node)
        code = _CODES[field.base]
        if code in _FLOATS:
            narrow = low > -_widest(code) or high < _widest(code)
        else:
            bits = 8 * _SIZES[code]
            least = -(2 ** (bits - 1)) if code.islower() else 0
            narrow = low > least or high < least + 2**bits - 1
        if narrow:
            self._conditions.append(condition.format(low=low, high=high, value=value))


def _widest(code: str) -> float:
    return FLOAT32_MAX if code == "f" else 1.797e308


@lru_cache(maxsize=_LAYOUTS)
def _texts(values: tuple[str, ...]) -> bytes:
    """Return texts, the first at a multiple of 4."""
    out = bytearray()
    for value in values:
        text = value.encode()
        out += bytes(-len(out) % 4) + struct.pack("<I", len(text) + 1) + text + b"\x00"
    return bytes(out)


class _TextsReader:
    """Reads texts; those that are the same as the last time, such as names, it only compares."""

    def __init__(self, order: str) -> None:
        self._length = struct.Struct(f"{order}I")
        self._last: tuple[int, bytes, tuple[str, ...]] = 0, b"", ()

    def __call__(self, data: bytes, at: int, number: int) -> tuple[tuple[str, ...], int]:
        known, same, values = self._last
        if number == known and data.startswith(same, at):
            return values, at + len(same)
        begin, texts = at, []
        for _ in range(number):
            at += -at % 4
            (length,) = self._length.unpack_from(data, at)
            at += 4 + length
            texts.append(data[at - length : at - 1].decode())
            if data[at - 1]:
                raise ValueError("a text without its end")
        self._last = number, data[begin:at], tuple(texts)
        return self._last[2], at


def _check_end(data: bytes, at: int) -> None:
    """Refuse what ends before it is complete, or goes on; padding to a multiple of 4 may be."""
    if at > len(data):
        raise ValueError("truncated")
    if len(data) - at > MAX_PADDING or any(data[at:]):
        raise ValueError(f"{len(data) - at} bytes more than the message has")


def _validated(message: Message) -> Message:
    """Return a message that may have values out of their bounds; raise which."""
    return msgspec.convert(msgspec.to_builtins(message, builtin_types=(bytes,)), type(message))
