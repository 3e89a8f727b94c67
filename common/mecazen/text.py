"""Text that others have sent, for a terminal."""

import json


def printable(text: str) -> str:
    """Return text with JSON's escapes for what moves a cursor, hides, or turns the line round.

    In JSON it stays the same value.
    """
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else json.dumps(one)[1:-1] for one in text)
