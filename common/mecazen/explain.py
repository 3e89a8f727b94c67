"""Explains an invalid configuration in one line: file, key, problem and allowed values."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterator
from datetime import date, datetime, time
from typing import Any

import msgspec
import msgspec.inspect as mi

from mecazen.config import Scenario, WorldConfig
from mecazen.config.scenario import NO_KEYS
from mecazen.robot import Robot
from mecazen.schema import Folder, Section

NameSource = Callable[[str, str, bool], str]
"""Returns the origin of a key's value, given the problem and whether it concerns a whole table."""


def explain(
    error: msgspec.ValidationError, raw: Any, kind: type[Section], prefix: str, source: NameSource
) -> str:
    """Turn msgspec's message into one line with file, key and allowed values."""
    problem, _, where = str(error).rpartition(" - at `$")
    if not problem:
        problem, where = where, ""
    steps = re.findall(r"\.?([A-Za-z0-9_-]+)|\[(\d+|\.\.\.)\]", where.rstrip("`"))
    node, value, trail = _descend(mi.type_info(kind), raw, [name or step for name, step in steps])
    # the messages of a struct's own checks and of checks of paths are complete
    own_words = error.__cause__ is not None
    unknown = re.match(r"Object contains unknown field `(.*)`$", problem, re.DOTALL)
    missing = re.match(r"Object missing required field `(.*)`$", problem)
    if unknown and not own_words:
        names = sorted(_fields(node))
        close = difflib.get_close_matches(unknown[1], names, n=1) or _elsewhere(unknown[1])
        problem = "unknown key; " + (f"did you mean {close[0]}? " if close else "")
        problem += f"allowed: {', '.join(names)}"
        trail = [*trail, unknown[1]]
    elif missing and not own_words:
        problem = f"missing; must be {describe(_fields(node).get(missing[1], node))}"
        trail = [*trail, missing[1]]
        others = (key for key in _missing(mi.type_info(kind), raw) if key != trail)
        names = [".".join(filter(None, (prefix, *key))) for key in others]
        problem += f"; also missing: {', '.join(names)}" if names else ""
    elif not own_words:
        problem = f"got {show(value)}; allowed: {describe(node)}{_unit(trail, value, node)}"
    elif not isinstance(node, mi.StructType):
        problem += f"; allowed: {describe(node)}"
    key = ".".join([prefix, *trail] if prefix else trail)
    name = source(key, problem, own_words and isinstance(node, mi.StructType))
    parts = (name, "" if name.endswith(f" with --set {key}") else key, problem)
    return one_line(": ".join(part for part in parts if part))


def _missing(node: mi.Type, value: Any) -> Iterator[list[str]]:
    """Yield the keys of all required values that a value lacks; msgspec reports only the first."""
    node = _choose(node, value)
    if isinstance(node, mi.StructType) and isinstance(value, dict):
        for field in node.fields:
            name = field.encode_name
            if name in value:
                yield from ([name, *key] for key in _missing(field.type, value[name]))
            elif field.required:
                yield [name]
    elif isinstance(node, mi.VarTupleType | mi.ListType) and isinstance(value, list | tuple):
        for index, item in enumerate(value):
            yield from ([str(index), *key] for key in _missing(node.item_type, item))


def _elsewhere(key: str) -> list[str]:
    """Return the keys of this name in the scenario's sections, with their sections."""
    sections = _fields(mi.type_info(Scenario)).items()
    return [f"{name}.{key}" for name, node in sections if key in _fields(node)]


def _unit(trail: list[str], value: Any, node: mi.Type) -> str:
    """Return a hint at the unit if a thousandth of a number that is too large is allowed."""
    most = getattr(node, "le", None)
    if most is not None and isinstance(value, int | float) and most < abs(value) <= 1000.0 * most:
        for suffix, unit in (("_m", "millimetres"), ("_kg", "grams")):
            if any(key.endswith(suffix) for key in trail):
                return f"; {value:g} looks like {unit}"
    return ""


def fields_of_choice(kind: type[Section], path: list[str], tag: object) -> set[str]:
    """Return the keys of the choice `tag` of the table at a path; empty if it has no choices."""
    node: mi.Type = mi.type_info(kind)
    for name in path:
        if isinstance(node, mi.VarTupleType):
            node = _choose(node.item_type, None)  # the name of an item
        else:
            node = _choose(_fields(node).get(name, node), None)
    choices = node.types if isinstance(node, mi.UnionType) else ()
    for choice in choices:
        if isinstance(choice, mi.StructType) and choice.tag == tag:
            return {*_fields(choice)}
    return set()


def one_line(text: str) -> str:
    """Return a text with line ends and control characters escaped."""
    return re.sub(r"[\x00-\x1f\x7f\x85\u2028\u2029]", lambda match: repr(match[0])[1:-1], text)


def show(value: Any) -> str:
    """Return a value as a reader of TOML expects it, shortened."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) >= 10**40:
        return "a number of too many digits"
    text = str(value) if isinstance(value, datetime | date | time) else repr(value)
    return text if len(text) <= 60 else f"{text[:60]}…"


def _descend(node: mi.Type, value: Any, steps: list[str]) -> tuple[mi.Type, Any, list[str]]:
    """Follow the steps of msgspec's path; return the type and value there, and their keys."""
    trail = []
    for step in steps:
        node = _choose(node, value)
        key = step
        if isinstance(node, mi.DictType):
            # msgspec does not name the key: take the first value that is no string, or no number
            kinds = str if isinstance(node.value_type, mi.StrType) else (int, float)
            wrong = {k: v for k, v in value.items() if type(v) is bool or not isinstance(v, kinds)}
            node, (key, value) = node.value_type, next(iter((wrong or value).items()))
        elif isinstance(node, mi.StructType):
            node, value = _fields(node).get(step, node), value.get(step)
        elif isinstance(node, mi.UnionType):  # no struct has the tag that is given here
            value = value.get(step)
        elif isinstance(node, mi.TupleType):
            node, value = node.item_types[int(step)], value[int(step)]
        elif isinstance(node, mi.VarTupleType | mi.ListType):
            node, value = node.item_type, value[int(step)]
            name = str(value.get("name", "")) if isinstance(value, dict) else ""
            key = name if re.fullmatch(r"[\w-]+", name) else step  # as in `--set`
        trail.append(key)
    return _choose(node, value), value, trail


def _choose(node: mi.Type, value: Any) -> mi.Type:
    """Return the member of a union that `value` selects by its tag, else the only one, if any."""
    if isinstance(node, mi.Metadata):
        node = node.type
    if not isinstance(node, mi.UnionType):
        return node
    members = [t for t in node.types if not isinstance(t, mi.NoneType)]
    tagged = [t for t in members if isinstance(t, mi.StructType) and isinstance(value, dict)]
    for member in tagged:
        if member.tag_field is not None and value.get(member.tag_field) == member.tag:
            return member
    return members[0] if len(members) == 1 else node


def _fields(node: mi.Type) -> dict[str, mi.Type]:
    """Return what a table may hold: the type of each key; for a union, the type of its tag."""
    if isinstance(node, mi.UnionType):
        return {
            t.tag_field: node for t in node.types if isinstance(t, mi.StructType) and t.tag_field
        }
    if not isinstance(node, mi.StructType):
        return {}
    tag = {node.tag_field: mi.LiteralType((node.tag,))} if node.tag_field else {}
    return {f.encode_name: f.type for f in node.fields if f.encode_name not in NO_KEYS} | tag


def describe(node: mi.Type) -> str:
    """Return what a value of this type may be, in words."""
    if isinstance(node, mi.Metadata):
        node = node.type
    if isinstance(node, mi.BoolType):
        return "true or false"
    if isinstance(node, mi.FloatType | mi.IntType):
        bounds = [
            f"{sign} {bound:.10g}"
            for sign, bound in ((">", node.gt), (">=", node.ge), ("<", node.lt), ("<=", node.le))
            if bound is not None
        ]
        return " ".join(
            [
                "a number" if isinstance(node, mi.FloatType) else "a whole number",
                " and ".join(bounds),
            ]
        ).strip()
    if isinstance(node, mi.StrType):
        return "a string" + (f" that matches {node.pattern}" if node.pattern else "")
    if isinstance(node, mi.LiteralType):
        return " or ".join(repr(value) for value in node.values)
    if isinstance(node, mi.UnionType):
        tags = [str(t.tag) for t in node.types if isinstance(t, mi.StructType) and t.tag]
        if tags:
            return " or ".join(repr(tag) for tag in tags)
        return " or ".join(describe(t) for t in node.types if not isinstance(t, mi.NoneType))
    if isinstance(node, mi.VarTupleType | mi.ListType):
        least, most = node.min_length, node.max_length
        bounds = [f"at least {least}"] * bool(least) + [f"at most {most}"] * (most is not None)
        count = f" of {f'{least}' if least == most else ' and '.join(bounds)}" if bounds else ""
        return f"a list{count}, each {describe(node.item_type)}"
    if isinstance(node, mi.TupleType):
        return "[" + ", ".join(describe(t) for t in node.item_types) + "]"
    if isinstance(node, mi.StructType):
        files = {Robot: "a robot file, or a table", WorldConfig: "a world file, or a table"}
        return files.get(node.cls, "a table")
    if isinstance(node, mi.AnyType):
        return "any value"
    if isinstance(node, mi.DictType):
        return f"a table, each value {describe(node.value_type)}"
    return "a path to a folder" if getattr(node, "cls", None) is Folder else "a path to a file"
