"""References in Markdown: configuration, from its structs; commands, from their own help."""

from __future__ import annotations

import ast
import inspect
import re
import sys
from collections import Counter
from collections.abc import Iterator
from enum import Enum
from functools import cache
from itertools import groupby, pairwise
from types import NoneType
from typing import Any, NamedTuple, get_args

import msgspec
import typer
from mecazen.config import Scenario
from mecazen.config.scenario import NO_KEYS
from mecazen.files import to_value
from mecazen.schema import LIVE
from msgspec import inspect as types

WIDE = 1e9
"""Bounds of this magnitude only exclude infinity; they are not shown."""
ALWAYS = {"--help", "--install-completion", "--show-completion"}
"""Options that need no row."""
SHARED = 2
"""An option of at least this number of commands is described once, in its most common meaning."""
HEAD = "| key | value | meaning |\n| --- | --- | --- |"


class _Row(NamedTuple):
    """A setting: its key relative to the chapter's, its default and range, its docstring."""

    keys: tuple[str, ...]
    value: str
    meaning: str
    kinds: tuple[str, ...] = ()
    """The tables that have this setting, if `kind` selects one of several tables."""


def configuration() -> str:
    """Return a chapter for each section of a scenario, with a row for each of its keys."""
    return "\n\n".join(_Chapters().write(Scenario))


class _Chapters:
    """The sections of a scenario; a struct is described where it first occurs."""

    def __init__(self) -> None:
        self._homes: dict[type, str] = {}

    def write(self, root: type) -> Iterator[str]:
        fields = [one for one in _fields(root) if one.name not in NO_KEYS]
        sections = [one for one in fields if _structs(one.type)]
        rows = [self._link(one) for one in sections if one.name in _docs(root)]
        rows += [self._plain(root, one, "") for one in fields if one not in sections]
        links = ", ".join(f"[{one.encode_name}](#{one.encode_name})" for one in sections)
        yield _chapter("top level", root, f"Tables: {links}.", rows)
        for one in sections:
            (struct,) = _structs(one.type)
            self._homes[struct.cls] = one.encode_name
            yield _chapter(one.encode_name, struct.cls, "", self._rows(struct, one.encode_name, ""))

    def _link(self, field: types.Field) -> _Row:
        name = field.encode_name
        return _Row((name,), f"[table](#{name})", _docs(Scenario).get(field.name, ""))

    def _plain(self, struct: type, field: types.Field, prefix: str) -> _Row:
        meaning = _docs(struct).get(field.name, "")
        return _Row((f"{prefix}{field.encode_name}",), _shown(field), meaning)

    def _rows(self, struct: types.StructType, section: str, prefix: str) -> list[_Row]:
        """Return the rows of a struct and of the structs in it that occur for the first time."""
        rows = []
        for field in struct.fields:
            row = self._plain(struct.cls, field, prefix)
            if found := _structs(field.type):
                rows += self._nested(row, field, found, section)
            else:
                rows.append(row)
        return rows

    def _nested(
        self, row: _Row, field: types.Field, found: list[types.StructType], section: str
    ) -> list[_Row]:
        (key,) = row.keys
        if _is_list(field.type):
            key += "[]"
        if found[0].cls in self._homes:
            home = self._homes[found[0].cls]
            link = f"as [{home}](#{_anchor(home.partition('.')[0])})"
            return [row._replace(value=", ".join(filter(None, (row.value, link))))]
        self._homes |= {one.cls: f"{section}.{key}" for one in found}
        if len(found) == 1:
            about = " ".join(filter(None, (row.meaning, _brief(found[0].cls))))
            first = row._replace(keys=(key,), meaning=about)
            return [first, *self._rows(found[0], section, f"{key}.")]
        merged: dict[_Row, tuple[str, ...]] = {}
        for one in found:
            tag = str(one.tag)
            for inner in self._rows(one, section, f"{key}."):
                merged[inner] = (*merged.get(inner, ()), tag)
        kinds = [_Row((f"{key}.kind",), f'`"{one.tag}"`', _brief(one.cls)) for one in found]
        every = tuple(str(one.tag) for one in found)
        own = [one._replace(kinds=() if tags == every else tags) for one, tags in merged.items()]
        return [row._replace(keys=(key,)), *kinds, *sorted(own, key=lambda one: bool(one.kinds))]


def _fields(struct: type) -> tuple[types.Field, ...]:
    kind = types.type_info(struct)
    assert isinstance(kind, types.StructType)
    return kind.fields


def _is_list(kind: types.Type) -> bool:
    return isinstance(_bare(kind)[0], types.VarTupleType | types.ListType)


def _structs(kind: types.Type) -> list[types.StructType]:
    """Return the structs that a type is made of."""
    kind, _ = _bare(kind)
    match kind:
        case types.StructType():
            return [kind]
        case types.UnionType():
            return [found for one in kind.types for found in _structs(one)]
        case types.VarTupleType() | types.ListType():
            return _structs(kind.item_type)
    return []


def _chapter(title: str, struct: type, links: str, rows: list[_Row]) -> str:
    """Return a chapter; neighbouring settings that differ only in their keys share a row."""
    lines = []
    for same, group in groupby(rows, key=lambda one: one[1:]):
        value, meaning, kinds = same
        keys = ", ".join(f"`{key}`" for one in group for key in one.keys)
        lines.append(_cells(f"{keys} ({', '.join(kinds)})" if kinds else keys, value, meaning))
    return "\n\n".join(
        filter(None, (f"## {title}", _about(struct), links, "\n".join((HEAD, *lines))))
    )


def _shown(field: types.Field) -> str:
    """Return the default of a field and its other allowed values."""
    kind, live = _bare(field.type)
    default = _default(field)
    parts = [default, *_words(kind, default), *(["live"] if live else [])]
    return ", ".join(dict.fromkeys(filter(None, parts)))


def _words(kind: types.Type, default: str) -> list[str]:
    """Return the allowed values of a type that `default` does not show."""
    kind, _ = _bare(kind)
    known = default.startswith("`") and default not in ("`[]`", "`{}`")
    match kind:
        case types.UnionType():
            return [word for one in kind.types for word in _words(one, default)]
        case types.LiteralType():
            return [f'`"{value}"`' for value in kind.values]
        case types.VarTupleType() | types.ListType():
            inner = ", ".join(_words(kind.item_type, default))
            if isinstance(_bare(kind.item_type)[0], types.FloatType):
                inner = f"numbers {inner}"
            return [inner if known or not inner else f"list of {inner}"]
        case types.TupleType():
            (each,) = {" ".join(_words(one, "`")) for one in kind.item_types}
            count = "" if known else f"{len(kind.item_types)} numbers"
            return [" ".join(filter(None, (count, each and f"each {each}")))]
        case types.DictType():
            return [] if known else [f"table of {' or '.join(_words(kind.value_type, default))}"]
        case types.FloatType():
            return [_range(kind) or ("" if known else "number")]
        case types.IntType():
            return [_range(kind) if known else f"integer {_range(kind)}".strip()]
        case types.CustomType():
            return ["folder" if kind.cls.__name__ == "Folder" else "file"]
        case types.StructType() | types.NoneType():
            return []
    plain = {types.BoolType: "boolean", types.StrType: "text"}
    return [] if known else [plain.get(type(kind), "any value")]


def commands(app: typer.Typer) -> str:
    """Return a chapter for each command of `mecazen`, with its arguments and options."""
    found = list(_walk(typer.main.get_command(app), "mecazen"))
    counts = Counter(row for _, command in found for row in set(_rows(command)))
    often = {_name(row): row for row, n in reversed(counts.most_common()) if n >= SHARED}
    shared = sorted(often.values())
    parts = ["## Options of several commands", "\n".join(shared)]
    for name, command in found:
        rows = _rows(command)
        parts += [f"## {name}", _help(command.help or "")]
        own = [row for row in rows if row not in shared]
        if both := [f"`{_name(row)}`" for row in rows if row in shared]:
            own.append(f"- [Shared](#options-of-several-commands): {', '.join(both)}.")
        parts += ["\n".join(own)] if own else []
    return "\n\n".join(parts)


def _walk(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    yield name, command
    for part, inner in sorted(getattr(command, "commands", {}).items()):
        yield from _walk(inner, f"{name} {part}")


def _rows(command: Any) -> list[str]:
    return [_option(one) for one in command.params if not ALWAYS & set(one.opts)]


def _name(row: str) -> str:
    return row.split("`")[1]


def _option(one: Any) -> str:
    """Return an argument or option as an item of a list."""
    if one.param_type_name == "argument":
        name = one.metavar or one.name.upper()
    else:
        value = "" if one.is_flag else f" {one.metavar or _value(one.type_descriptor.annotation)}"
        name = ", ".join(one.opts) + value
    shown = one.show_default
    if one.required:
        default = ""
    elif isinstance(shown, str):
        default = shown.replace("<", "&lt;")
    elif shown and one.default not in (None, False, ()):
        default = f"`{one.default}`"
    else:
        default = ""
    words = f"`{name}` ({default})" if default not in ("", "none") else f"`{name}`"
    return f"- {words}: {_line(one.help)}" if one.help else f"- {words}"


def _value(kind: Any) -> str:
    """Return the placeholder of an option's value."""
    if choices := get_args(kind):
        return _value(choices[0]) if NoneType in choices else "|".join(map(str, choices))
    if issubclass(kind, Enum):
        return "|".join(str(one.value) for one in kind)
    return {int: "INTEGER", float: "NUMBER"}.get(kind, "TEXT")


def _help(text: str) -> str:
    """Return a help text as paragraphs, its examples as code."""
    text, _, examples = inspect.cleandoc(re.sub(r"\[/?(bold)?\]", "", text)).partition("Example")
    paragraphs = [_line(part) for part in text.split("\n\n") if part.strip()]
    if examples:
        lines = _line(examples.partition(":")[2]).split(" · ")
        paragraphs.append("```sh\n" + "\n".join(line.strip() for line in lines) + "\n```")
    return "\n\n".join(paragraphs)


def _bare(kind: types.Type) -> tuple[types.Type, bool]:
    """Return a type without its metadata, and whether a running simulation may change it."""
    live = False
    while isinstance(kind, types.Metadata):
        live |= bool((kind.extra or {}).get(LIVE))
        kind = kind.type
    return kind, live


def _range(kind: types.FloatType | types.IntType) -> str:
    low = next((b for b in (kind.gt, kind.ge) if b is not None and b > -WIDE), None)
    high = next((b for b in (kind.lt, kind.le) if b is not None and b < WIDE), None)
    words = []
    if low is not None:
        words.append(f"{'>' if kind.gt is not None else '≥'} {low:.10g}")
    if high is not None:
        words.append(f"{'<' if kind.lt is not None else '≤'} {high:.10g}")
    if len(words) == 2 and kind.gt is None and kind.lt is None:
        return f"{low:.10g} to {high:.10g}"
    return " and ".join(words)


def _default(field: types.Field) -> str:
    if field.required:
        return "required"
    value = field.default
    if value is msgspec.NODEFAULT:
        value = field.default_factory() if callable(field.default_factory) else None
    if value is None:
        return "none"
    if isinstance(value, msgspec.Struct):
        tag = value.__struct_config__.tag
        return f'`"{tag}"`' if tag else ""
    return f"`{to_value(msgspec.to_builtins(value, enc_hook=str))}`"


def _about(struct: type) -> str:
    text, _, _ = (inspect.getdoc(struct) or "").partition("\n\nRaises:")
    return _paragraphs(text)


def _brief(struct: type) -> str:
    """Return the first paragraph of a struct's description."""
    return _about(struct).partition("\n\n")[0]


@cache
def _docs(struct: type) -> dict[str, str]:
    """Return the docstring of each field of a struct, also of those that it inherits."""
    found: dict[str, str] = {}
    for base in reversed(struct.__mro__):
        module = sys.modules.get(base.__module__)
        if not (module and issubclass(base, msgspec.Struct) and hasattr(module, "__file__")):
            continue
        if not (module.__file__ or "").endswith(".py"):
            continue
        tree = ast.parse(inspect.getsource(module))
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and node.name == base.__name__:
                found |= _described(node.body)
    return found


def _described(body: list[ast.stmt]) -> dict[str, str]:
    return {
        one.target.id: _line(text.value.value)
        for one, text in pairwise(body)
        if isinstance(one, ast.AnnAssign)
        and isinstance(one.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }


def _cells(*cells: str) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def _paragraphs(text: str) -> str:
    return "\n\n".join(_line(part) for part in text.split("\n\n"))


def _line(text: str) -> str:
    return " ".join(text.split())


def _anchor(title: str) -> str:
    """Return the anchor of a heading, as GitHub and MkDocs make it."""
    return re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", title.lower()).strip())
