"""Generates the function that encodes a type in CDR."""

from __future__ import annotations

import struct
from functools import lru_cache

import msgspec.inspect as mi

from mecazen.messages import Message
from mecazen.ros.fields import Field, fields
from mecazen.ros.layouts import CODES, HEADER, LAYOUTS, FunctionWriter, layouts


class Encoder(FunctionWriter):
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
            self._add(CODES[field.base], 1, value)

    def _items(self, field: Field, value: str, fixed: int | None, length: str) -> None:
        if isinstance(field.node, mi.BytesType):
            self._add("s", fixed, value, length)
        elif field.base in CODES:
            self._add(CODES[field.base], fixed, f"*{value}", length)
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
        layout = layouts("<", self._pieces)
        if self._has_parts or self._lengths:
            begin = "at & 7" if self._has_parts else "0"
            pack = f"{self.new(layout)}({', '.join([begin, *self._lengths])}).pack"
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


@lru_cache(maxsize=LAYOUTS)
def _texts(values: tuple[str, ...]) -> bytes:
    """Return texts, the first at a multiple of 4."""
    out = bytearray()
    for value in values:
        text = value.encode()
        out += bytes(-len(out) % 4) + struct.pack("<I", len(text) + 1) + text + b"\x00"
    return bytes(out)
