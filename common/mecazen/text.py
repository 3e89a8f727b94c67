"""Prepares received text for a terminal, and finds the unknown fields of received messages."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterator
from typing import Any

import msgspec

NAME_CHARACTERS = 60
"""Maximum length of a received name in a line of text, since senders set no limit."""


def printable(text: str) -> str:
    """Return text with JSON's escapes for characters that move a cursor, hide, or reverse a line.

    As JSON, the escaped text has the same value.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)


def shortened(name: str) -> str:
    """Return a name for a terminal, cut to `NAME_CHARACTERS`."""
    cut = name if len(name) <= NAME_CHARACTERS else f"{name[:NAME_CHARACTERS]}…"
    return printable(cut)


def unknown_fields(tables: Any, message: msgspec.Struct, within: str = "") -> Iterator[str]:
    """Yield a line for each ignored field, with a suggestion of a similar field.

    Args:
        tables: The decoded JSON, as plain tables.
        message: The message decoded from it.
        within: The enclosing field, followed by a dot; empty at the top.
    """
    allowed = message.__struct_fields__
    for name, value in tables.items():
        if name not in allowed:
            close = difflib.get_close_matches(shortened(name), allowed, n=1)
            suggestion = f"did you mean {close[0]}? " if close else ""
            ignored = f"{within}{shortened(name)} is ignored"
            yield f"{ignored}; {suggestion}allowed: {', '.join(allowed)}"
        elif isinstance(field := getattr(message, name), msgspec.Struct):
            yield from unknown_fields(value, field, f"{within}{name}.")
