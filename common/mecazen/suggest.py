"""Reports of unknown fields in JSON messages: decoding ignores them, but they are mistakes."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import Any

import msgspec

from mecazen.text import shortened


def unknown_fields(given: Any, message: msgspec.Struct, within: str = "") -> Iterator[str]:
    """Yield a line for each ignored field, with a suggestion of a similar field.

    Args:
        given: The decoded JSON, as plain tables.
        message: The message decoded from it.
        within: The enclosing field, followed by a dot; empty at the top.
    """
    if not isinstance(given, dict):
        return
    allowed = message.__struct_fields__
    for name, value in given.items():
        if name not in allowed:
            close = difflib.get_close_matches(shortened(name), allowed, n=1)
            suggestion = f"did you mean {close[0]}? " if close else ""
            told = f"{within}{shortened(name)} is ignored"
            yield f"{told}; {suggestion}allowed: {', '.join(allowed)}"
        elif isinstance(field := getattr(message, name), msgspec.Struct):
            yield from unknown_fields(value, field, f"{within}{name}.")
