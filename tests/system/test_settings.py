"""Every setting is read by code."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import msgspec.inspect as mi
from harness import ROOT
from mecazen.config import Scenario
from mecazen.config.services import AngularLimits, LinearLimits
from mecazen.schema import fields, members

CODE = ("common", "people", "services", "tools", "ros2")


def settings_of(node: mi.Type) -> Iterator[str]:
    """Yield the name of each setting of a table and of the tables within."""
    for kind in members(node):
        if isinstance(kind, mi.VarTupleType):
            yield from settings_of(kind.item_type)
        for name, inner in fields(kind).items():
            if name != "kind":
                yield name
            yield from settings_of(inner)


def test_code_reads_every_setting():
    # the limits are read as a tuple
    read = {*LinearLimits.__struct_fields__, *AngularLimits.__struct_fields__}
    for file in (path for part in CODE for path in (ROOT / part).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Attribute):
                read.add(node.attr)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                read |= {*node.value.split(".")}  # the key of a rate, a name for getattr
    assert {*settings_of(mi.type_info(Scenario))} - read == set()
