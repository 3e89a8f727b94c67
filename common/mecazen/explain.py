"""Converts tables to structs, and explains what is wrong: the key, and the allowed values."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator
from datetime import date, datetime, time
from typing import Any

import msgspec
import msgspec.inspect as mi

from mecazen.schema import Folder, Section, below, choose, fields, members


def explain(
    error: msgspec.ValidationError, raw: Any, kind: type[Section], prefix: str = ""
) -> tuple[str, str]:
    """Return the key that msgspec's error is about, and the problem with the allowed values.

    Args:
        error: The error of converting `raw` to `kind`.
        raw: Tables of TOML.
        kind: The struct.
        prefix: The key of the tables.
    """
    problem, _, path = str(error).rpartition(" - at `$")
    if not problem:
        problem, path = path, ""
    top = mi.type_info(kind)
    steps = [name or index for name, index in re.findall(r"\.([\w-]+)|\[(\d+)\]", path)]
    key, node, value = _follow(top, raw, steps)
    unknown = re.match(r"Object contains unknown field `(.*)`$", problem, re.DOTALL)
    if error.__cause__ is not None:
        pass  # the message of a struct's own check, or of a path's, is complete
    elif unknown:
        name, allowed = unknown[1], sorted(fields(node))
        sections = [section for section, kind in fields(top).items() if name in fields(kind)]
        problem = "unknown key; " + suggestion(name, allowed, (f"{s}.{name}" for s in sections))
        problem += f"allowed: {', '.join(allowed)}"
        key.append(name)
    elif problem.startswith("Object missing"):
        missing = [".".join(filter(None, (prefix, *names))) for names in _missing(top, raw)]
        return ", ".join(missing), "missing"
    else:
        # a path of msgspec does not name the key of a table of any keys: show all of it
        shown = repr(value) if isinstance(node, mi.DictType) else show(value)
        problem = f"got {shown:.60}; allowed: {describe(node)}{_unit_hint(key, value, node)}"
    return ".".join(filter(None, (prefix, *key))), problem


def _unit_hint(key: Iterable[str], value: Any, node: mi.Type) -> str:
    """Return a hint at the unit if a thousandth of a number that is too large is allowed."""
    largest = getattr(node, "le", None)
    if not isinstance(value, int | float) or largest is None:
        return ""
    if largest < abs(value) <= 1000.0 * largest:
        for suffix, unit in (("_m", "millimetres"), ("_kg", "grams")):
            if any(name.endswith(suffix) for name in key):
                return f"; {value:g} looks like {unit}"
    return ""


def suggestion(word: str, known: Iterable[str], distant: Iterable[str] = ()) -> str:
    """Return "did you mean …? " with the most similar word, else the first distant; or ""."""
    close = difflib.get_close_matches(word, list(known), n=1) or [*distant]
    return f"did you mean {close[0]}? " if close else ""


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


def describe(node: mi.Type) -> str:
    """Return the allowed values of a type in words."""
    choices = members(node)
    tags = [repr(kind.tag) for kind in choices if isinstance(kind, mi.StructType) and kind.tag]
    return " or ".join(tags or map(_describe, choices))


def _describe(node: mi.Type) -> str:
    match node:
        case mi.BoolType():
            return "true or false"
        case mi.FloatType() | mi.IntType():
            limits = (">", node.gt), (">=", node.ge), ("<", node.lt), ("<=", node.le)
            bounds = [f"{sign} {bound:.10g}" for sign, bound in limits if bound is not None]
            number = "a number" if isinstance(node, mi.FloatType) else "a whole number"
            return f"{number} {' and '.join(bounds)}".strip()
        case mi.StrType(pattern=pattern):
            return f"a string that matches {pattern}" if pattern else "a string"
        case mi.LiteralType(values=values):
            return " or ".join(map(repr, values))
        case mi.VarTupleType() | mi.ListType():
            least, most = node.min_length, node.max_length
            bounds = [f"at least {least}"] * bool(least) + [f"at most {most}"] * (most is not None)
            count = f" of {least if least == most else ' and '.join(bounds)}" if bounds else ""
            return f"a list{count}, each {describe(node.item_type)}"
        case mi.TupleType(item_types=items):
            return f"[{', '.join(map(describe, items))}]"
        case mi.StructType(array_like=True, fields=columns):
            return f"[{', '.join(column.encode_name for column in columns)}]"
        case mi.StructType():
            return "a table"
        case mi.DictType(value_type=item):
            return f"a table, each value {describe(item)}"
        case mi.CustomType(cls=cls):
            return f"a path to a {'folder' if cls is Folder else 'file'}"
        case _:
            return "any value"


def _follow(node: mi.Type, value: Any, steps: Iterable[str]) -> tuple[list[str], mi.Type, Any]:
    """Follow msgspec's path to a value; return its key, with robots by name, its type and it."""
    key = []
    for step in steps:
        node = choose(node, value)
        if isinstance(node, mi.DictType):  # msgspec's path does not name its keys
            break
        value = value.get(step) if isinstance(value, dict) else value[int(step)]
        is_row = isinstance(node, mi.StructType) and node.array_like
        part = [*fields(node)][int(step)] if is_row else step
        node = below(node, part)
        name = value.get("name") if part.isdigit() and isinstance(value, dict) else None
        key.append(name if isinstance(name, str) and re.fullmatch(r"[\w-]+", name) else part)
    return key, choose(node, value), value


def _missing(node: mi.Type, value: Any) -> Iterator[list[str]]:
    """Yield the keys of all required values that a value lacks; msgspec reports only the first."""
    node = choose(node, value)
    if isinstance(node, mi.StructType) and isinstance(value, dict):
        for field in node.fields:
            name = field.encode_name
            if name in value:
                yield from ([name, *key] for key in _missing(field.type, value[name]))
            elif field.required:
                yield [name]
    elif isinstance(node, mi.UnionType) and isinstance(value, dict):
        yield from ([tag] for tag in fields(node).keys() - value.keys())
    elif isinstance(node, mi.VarTupleType | mi.ListType) and isinstance(value, list | tuple):
        for index, item in enumerate(value):
            yield from ([str(index), *key] for key in _missing(node.item_type, item))
