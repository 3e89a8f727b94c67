"""Text that others have sent, for a terminal."""

import json

NAME_CHARACTERS = 60
"""Maximum length of a received name in a line of text, since senders set no limit."""


def printable(text: str) -> str:
    """Return text with JSON's escapes for what moves a cursor, hides, or turns the line round.

    In JSON it stays the same value.
    """
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else json.dumps(one)[1:-1] for one in text)


def shortened(name: str) -> str:
    """Return a name for a terminal, of which too much is left out."""
    cut = name if len(name) <= NAME_CHARACTERS else f"{name[:NAME_CHARACTERS]}…"
    return printable(cut)
