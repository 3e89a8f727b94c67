"""What a message looks like in a file, for readers that know nothing of mecazen."""

from __future__ import annotations

from typing import NamedTuple

import msgspec
from mecazen.messages import Message
from mecazen.wire import encode

from mecazen_recorder import cdr
from mecazen_recorder.config import Encoding


class Schema(NamedTuple):
    """An MCAP schema."""

    name: str
    encoding: str
    data: bytes


def schema(kind: type[Message], encoding: Encoding) -> Schema:
    """Return a message's schema: ROS's definition for CDR, else a JSON schema."""
    if encoding == "cdr":
        return Schema(kind.ROS_TYPE, "ros2msg", cdr.definition(kind).encode())
    _, definitions = msgspec.json.schema_components([kind], ref_template="#/$defs/{name}")
    # readers want the message itself at the root, not a reference to it
    text = msgspec.json.encode({**definitions[kind.__name__], "$defs": definitions})
    return Schema(kind.ROS_TYPE, "jsonschema", text)


def write(message: Message, encoding: Encoding) -> bytes:
    """Return a message as it stands in a file."""
    return cdr.encode(message) if encoding == "cdr" else encode(message, "json")
