"""Messages of every type, drawn by hypothesis with the extremes of their bounds; and their bits."""

import math
from typing import Any

import msgspec
import msgspec.inspect as mi
from hypothesis import strategies as st
from mecazen import messages
from mecazen.messages import Message

KINDS = [
    kind
    for kind in vars(messages).values()
    if isinstance(kind, type) and issubclass(kind, Message)
    # a query's, whose seed may be none: ROS can't say that
    if kind not in {Message, messages.ResetRequest}
]
SINGLE = 3.4028234663852886e38
"""The bound of what ROS holds in 32 bits."""


def values(node: mi.Type) -> st.SearchStrategy[Any]:
    """All values of a type, with the extremes of its bounds."""
    if isinstance(node, mi.Metadata):
        return values(node.type)
    if isinstance(node, mi.StructType):
        fields = msgspec.structs.fields(node.cls)
        return st.builds(node.cls, **{f.name: values(mi.type_info(f.type)) for f in fields})
    if isinstance(node, mi.VarTupleType):
        longest = node.max_length or 4
        items = st.lists(values(node.item_type), min_size=node.min_length or 0, max_size=longest)
        return items.map(tuple)
    if isinstance(node, mi.FloatType):
        low = -math.inf if node.ge is None else node.ge
        width = 32 if node.le == SINGLE else 64
        return st.floats(low, node.le, allow_nan=False, allow_infinity=False, width=width)
    if isinstance(node, mi.IntType):
        assert node.ge is not None
        high = node.le if node.lt is None else node.lt - 1
        return st.integers(int(node.ge), int(high)) | st.sampled_from([int(node.ge), int(high)])
    if isinstance(node, mi.BytesType):
        return st.binary(max_size=8)
    return {mi.StrType: st.text(max_size=8), mi.BoolType: st.booleans()}[type(node)]


def drawn(kind: type[Message]) -> st.SearchStrategy[Any]:
    """All messages of a type."""
    return values(mi.type_info(kind))


def bits(value: Any) -> Any:
    """Return a value whose equality is that of bits: -0.0 is not 0.0."""
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, dict):
        return {name: bits(item) for name, item in value.items()}
    return [bits(item) for item in value] if isinstance(value, list | tuple | bytes) else value


def plain(message: Message) -> Any:
    """Return the bits of a message by field."""
    return bits(msgspec.to_builtins(message, builtin_types=(bytes,)))
