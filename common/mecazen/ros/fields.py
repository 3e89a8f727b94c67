"""The fields of messages as ROS 2 sees them.

The type of a field follows from its annotation: an integer takes the fewest of 8, 16, 32 or 64
bits that hold its bounds, `bytes` are `uint8[]`, and a tuple whose least and greatest lengths are
one is an array. `msgspec.Meta(extra={"ros": "byte"})` names a type that the bounds can't tell.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import msgspec.inspect as mi

from mecazen.errors import MecazenError
from mecazen.messages import Message

FLOAT32_MAX = 3.4028234663852886e38

# ids of type_description_interfaces/msg/FieldType; an array of a type, a sequence of at most N and
# one of any length are numbered the same way, each 48 further
_IDS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8,
    "uint64": 9, "float32": 10, "float64": 11, "bool": 15, "byte": 16, "string": 17,
}  # fmt: skip
_NESTED_ID = 1
_BOUNDED_STRING_ID = 21
_SHAPE_IDS = {"": 0, "[{}]": 48, "[<={}]": 96, "[]": 144}


class RosTypeError(MecazenError):
    """A message with a field that ROS has no type for."""


class Field(NamedTuple):
    """A field of a message as ROS sees it."""

    name: str
    base: str
    """Of one item: `float64`, `string`, … or the name of a message."""
    kind: type[Message] | None = None
    """The struct of a message."""
    shape: str = ""
    """Empty for one item, else `[{}]`, `[<={}]` or `[]`; the brace stands for `length`."""
    length: int = 0
    node: mi.Type | None = None
    """The annotation of one item, with its bounds."""

    @property
    def capacity(self) -> int:
        """The most characters of a text; 0 where it may have any number."""
        return self.node.max_length or 0 if isinstance(self.node, mi.StrType) else 0

    @property
    def text(self) -> str:
        """The field in a definition."""
        bound = f"<={self.capacity}" if self.capacity else ""
        own = self.base.replace("/msg/", "/")
        return f"{own}{bound}{self.shape.format(self.length)} {self.name}"

    @property
    def description(self) -> dict[str, Any]:
        """The field as type_description_interfaces/msg/Field."""
        nested = "/" in self.base
        number = _NESTED_ID if nested else _BOUNDED_STRING_ID if self.capacity else _IDS[self.base]
        kind = {
            "type_id": number + _SHAPE_IDS[self.shape],
            "capacity": self.length,
            "string_capacity": self.capacity,
            "nested_type_name": self.base if nested else "",
        }
        return {"name": self.name, "type": kind}


@cache
def fields(kind: type[Message]) -> tuple[Field, ...]:
    """Return the fields of a message in order.

    Raises:
        RosTypeError: ROS has no type for a field.
    """
    info = mi.type_info(kind)
    assert isinstance(info, mi.StructType)
    found = []
    for field in info.fields:
        try:
            found.append(_field(field.name, field.type))
        except KeyError as error:
            what = f"{kind.ROS_TYPE}: {field.name}: ROS has no type for {error.args[0]}"
            raise RosTypeError(what) from None
    return tuple(found)


def _field(name: str, node: mi.Type) -> Field:
    """Return a field; a KeyError holds the annotation that ROS has no type for."""
    extra = None
    if isinstance(node, mi.Metadata):
        extra, node = (node.extra or {}).get("ros"), node.type
    if isinstance(node, mi.VarTupleType | mi.BytesType):
        shape, length = "[]", 0
        if node.max_length is not None:
            shape = "[{}]" if node.min_length == node.max_length else "[<={}]"
            length = node.max_length
        if isinstance(node, mi.BytesType):
            return Field(name, extra or "uint8", None, shape, length, node)
        item = _field(name, node.item_type)
        if item.shape:
            raise KeyError("a sequence of sequences")
        return item._replace(shape=shape, length=length)
    if isinstance(node, mi.StructType) and issubclass(node.cls, Message):
        return Field(name, node.cls.ROS_TYPE, node.cls)
    return Field(name, extra or _primitive(node), node=node)


def _primitive(node: mi.Type) -> str:
    if isinstance(node, mi.IntType):
        low, high = bounds(node)
        for bits in (8, 16, 32, 64):
            for sign, least in (("u", 0), ("", -(2 ** (bits - 1)))):
                if low >= least and high < least + 2**bits:
                    return f"{sign}int{bits}"
        return "uint64" if low >= 0 else "int64"
    if isinstance(node, mi.FloatType):
        return "float32" if node.le == FLOAT32_MAX else "float64"
    if isinstance(node, mi.StrType):
        return "string"
    if isinstance(node, mi.BoolType):
        return "bool"
    raise KeyError(type(node).__name__.removesuffix("Type").lower())


def bounds(node: mi.IntType | mi.FloatType) -> tuple[float, float]:
    """Return the least and the greatest value of a whole number; infinite where there is none."""
    low = node.ge if node.ge is not None else node.gt + 1 if node.gt is not None else -float("inf")
    high = node.le if node.le is not None else node.lt - 1 if node.lt is not None else float("inf")
    return low, high
