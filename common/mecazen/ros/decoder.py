"""Generates the function that decodes a type from CDR."""

from __future__ import annotations

import struct

import msgspec
import msgspec.inspect as mi

from mecazen.messages import Message
from mecazen.ros.fields import FLOAT32_MAX, Field, bounds, fields
from mecazen.ros.layouts import CODES, FLOATS, HEADER, SIZES, FunctionWriter, layouts

MAX_PADDING = 3

_LARGE = 1e300
"""Numbers whose hypotenuse is below are finite, and within every bound that is no narrower."""


class Decoder(FunctionWriter):
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
            self._take("B")
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
        value = self._take(CODES[field.base])
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
        if field.base not in CODES:
            self._flush()
            self._locate()
            return self._strings(length) if field.kind is None else self._messages(field, length)
        all_within = "(not {value} or {low} <= min({value}) and max({value}) <= {high})"
        if field.shape == "[{}]":
            value = self._take(CODES[field.base], field.length)
            self._check(field, value, all_within)
        else:
            value = self._sequence(CODES[field.base], length)
            self._check(field, value, all_within)
            self._require()
        return value

    def _sequence(self, code: str, length: str) -> str:
        layout, value = self.new(), self.new()
        by_length = self.new(layouts(self._order, [(code, None)]))
        self.line(f"{layout} = {by_length}(at & 7, {length})")
        self.line(f"{value} = {layout}.unpack_from(data, at); at += {layout}.size")
        if code in FLOATS and self._finite:
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

    def _take(self, code: str, number: int | None = None) -> str:
        """Return the expression of a value of fixed size, or of an array of them."""
        begin = self._taken
        self._taken += 1 if number is None else number
        self._pieces.append((code, self._taken - begin))
        place = f"{begin}" if number is None else f"{begin}:{self._taken}"
        return f"{self._run}[{place}]"

    def _length(self) -> str:
        """Return the expression of a length that comes next; `at` is behind it then."""
        length = self._take("I")
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
        layout = layouts(self._order, self._pieces)
        if self._at is not None:
            unpack = self.new(layout(self._at & 7).unpack_from)
            self.line(f"{self._run} = {unpack}(data, {self._at})")
            self._at += layout(self._at & 7).size
        else:
            by_offset, one = self.new([layout(at) for at in range(8)]), self.new()
            self.line(f"{one} = {by_offset}[at & 7]")
            self.line(f"{self._run} = {one}.unpack_from(data, at); at += {one}.size")
        if self._finite and any(code in FLOATS for code, _ in self._pieces):
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
        code = CODES[field.base]
        if code in FLOATS:
            narrow = low > -_widest(code) or high < _widest(code)
        else:
            bits = 8 * SIZES[code]
            least = -(2 ** (bits - 1)) if code.islower() else 0
            narrow = low > least or high < least + 2**bits - 1
        if narrow:
            self._conditions.append(condition.format(low=low, high=high, value=value))


def _widest(code: str) -> float:
    return FLOAT32_MAX if code == "f" else 1.797e308


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
