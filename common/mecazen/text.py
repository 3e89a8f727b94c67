"""Prepares received text for a terminal."""

from __future__ import annotations

import json

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
