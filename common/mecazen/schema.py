"""Building blocks of configuration structs: a strict base class, ranges, and walks over types."""

from __future__ import annotations

from pathlib import PosixPath
from typing import Annotated, Any, TypeVar, dataclass_transform

import msgspec
import msgspec.inspect as mi

FieldT = TypeVar("FieldT")

LIVE = "live"
"""Key in `Meta.extra` of the fields that may change while a simulation runs."""
Live = Annotated[FieldT, msgspec.Meta(extra={LIVE: True})]
"""Type of such a field: `standoff_m: Live[Positive] = 1.0`."""

Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e9)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0, le=1e9)]
Finite = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]
Probability = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Length = Annotated[float, msgspec.Meta(gt=0.0, le=5.0)]
"""Length of a part of a robot [m]; millimetres are out of range."""
WheelRadius = Annotated[float, msgspec.Meta(gt=0.0, le=0.5)]
Mass = Annotated[float, msgspec.Meta(gt=0.0, le=2000.0)]
"""Mass of a part of a robot [kg]; a platform for heavy loads has 1 t."""
AngleDeg = Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)]


PROGRAM = "^.+$"
"""The pattern of a program, whose file is located as a path."""
Program = Annotated[str, msgspec.Meta(pattern=PROGRAM)]
"""`file.py:Class`, `module:Class`, or the name of something installed."""


class Folder(PosixPath):
    """A path to a folder; a plain `Path` in a configuration is a path to a file."""


class OutputFile(PosixPath):
    """A path to a file to write, which need not exist."""


# msgspec's structs are immutable by inheritance, which type checkers can't see by themselves
@dataclass_transform(frozen_default=True, field_specifiers=(msgspec.field,))
class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of a configuration file: immutable, and strict about its keys."""


SectionT = TypeVar("SectionT", bound=Section)

NO_KEYS = ("robot_name", "others")
"""Fields of a scenario that are no keys of a file: `Scenario.of` fills them in."""


def is_live(node: mi.Type) -> bool:
    """Return whether a field of this type may change while a simulation runs."""
    return isinstance(node, mi.Metadata) and bool((node.extra or {}).get(LIVE))


def members(node: mi.Type) -> tuple[mi.Type, ...]:
    """Return the types that a value may have, without metadata and None."""
    if isinstance(node, mi.Metadata):
        return members(node.type)
    if isinstance(node, mi.UnionType):
        return tuple(member for kind in node.types for member in members(kind))
    return () if isinstance(node, mi.NoneType) else (node,)


def choose(node: mi.Type, value: Any) -> mi.Type:
    """Return the only member of a type, or the one that the value selects by its tag.

    If the value selects none, return the type itself.
    """
    choices = members(node)
    if len(choices) > 1 and isinstance(value, dict):
        choices = tuple(
            kind
            for kind in choices
            if isinstance(kind, mi.StructType) and value.get(kind.tag_field or "") == kind.tag
        )
    return choices[0] if len(choices) == 1 else node


def fields(node: mi.Type) -> dict[str, mi.Type]:
    """Return the types of the keys of a table, its tag included; of a choice, only the tag."""
    keys: dict[str, mi.Type] = {}
    structs = [kind for kind in members(node) if isinstance(kind, mi.StructType)]
    if len(structs) == 1:
        (struct,) = structs
        keys = {f.encode_name: f.type for f in struct.fields if f.encode_name not in NO_KEYS}
    tags = {kind.tag_field: kind.tag for kind in structs if kind.tag_field}
    return keys | {field: mi.LiteralType(tuple(kind.tag for kind in structs)) for field in tags}


def below(node: mi.Type, key: str) -> mi.Type:
    """Return the type of the value at a key of a table, or at an index of a list."""
    match node:
        case mi.VarTupleType(item_type=kind) | mi.ListType(item_type=kind):
            return kind
        case mi.DictType(value_type=kind):
            return kind
        case mi.TupleType(item_types=kinds):
            return dict(zip(map(str, range(len(kinds))), kinds, strict=True)).get(key, mi.AnyType())
    return fields(node).get(key, mi.AnyType())
