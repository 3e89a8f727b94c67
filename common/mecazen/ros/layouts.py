"""Layouts of what a message contains, and how a function that uses them is written."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import lru_cache
from itertools import count
from math import hypot, inf
from typing import Any, cast

HEADER = b"\x00\x01\x00\x00"
"""Of what is written: little-endian, no padding at the end."""
CODES = {
    "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float32": "f", "float64": "d", "bool": "?", "byte": "B",
}  # fmt: skip
SIZES = {code: struct.calcsize(f"<{code}") for code in CODES.values()} | {"s": 1}
FLOATS = "fd"
LAYOUTS = 256
"""So many lengths of what a message contains are remembered, for each place in it."""

Pieces = list[tuple[str, int | None]]
"""Struct codes with how many of each; None where the message says how many."""


def layouts(order: str, pieces: Pieces) -> Callable[..., struct.Struct]:
    """Return what gives the layout of `pieces` from an offset (modulo 8) and the open lengths."""

    @lru_cache(maxsize=LAYOUTS)
    def layout(at: int, *lengths: int) -> struct.Struct:
        rest = iter(lengths)
        text = order
        for code, fixed in pieces:
            length = next(rest) if fixed is None else fixed
            if length or code == "s":  # a list without items is not aligned
                pad = (4 - at) % SIZES[code]  # counted after the header
                text += f"{pad}x{length}{code}"
                at += pad + length * SIZES[code]
        return struct.Struct(text)

    return layout


class FunctionWriter:
    """Lines of a function, and the names in it."""

    def __init__(self, argument: str) -> None:
        self._lines = [f"def function({argument}):"]
        self._depth = 1
        self._numbers = count()
        self._names: dict[str, Any] = {"hypot": hypot, "inf": inf}
        self._pieces: Pieces = []

    def line(self, text: str) -> None:
        """Add a line."""
        self._lines.append("    " * self._depth + text)

    def new(self, value: Any = None) -> str:
        """Return a new name; it stands for `value` if that is given."""
        name = f"n{next(self._numbers)}"
        if value is not None:
            self._names[name] = value
        return name

    def build(self) -> Callable[[Any], Any]:
        """Return the function."""
        exec("\n".join(self._lines), self._names)  # noqa: S102  # made of names of fields alone
        return cast(Callable[[Any], Any], self._names["function"])
