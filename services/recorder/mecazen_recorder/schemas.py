"""Schemas of messages in a file, for readers that do not know mecazen."""

from __future__ import annotations

from typing import NamedTuple

import msgspec
from mecazen.messages import Message

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
    # readers expect the message at the root, not a reference to it
    text = msgspec.json.encode({**definitions[kind.__name__], "$defs": definitions})
    return Schema(kind.ROS_TYPE, "jsonschema", text)
