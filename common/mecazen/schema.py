"""Building blocks of configuration structs: a strict base class and ranges of numbers."""

from __future__ import annotations

from pathlib import PosixPath
from typing import Annotated, TypeVar, dataclass_transform

import msgspec

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


class Folder(PosixPath):
    """A path to a folder; a plain `Path` in a configuration is a path to a file."""


class Output(PosixPath):
    """A path to a file to write, which need not exist."""


# msgspec's structs are immutable by inheritance, which type checkers can't see by themselves
@dataclass_transform(frozen_default=True, field_specifiers=(msgspec.field,))
class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of a configuration file: immutable, and strict about its keys."""


SectionT = TypeVar("SectionT", bound=Section)
