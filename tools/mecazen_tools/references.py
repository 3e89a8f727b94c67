"""References in Markdown: configuration, from its structs; commands, from their own help."""

from __future__ import annotations

import ast
import inspect
import json
import re
import sys
from collections import Counter
from collections.abc import Iterator
from enum import Enum
from functools import cache
from itertools import pairwise
from types import NoneType
from typing import Any, get_args

import msgspec
import typer
from mecazen.config import Scenario
from mecazen.config.scenario import NO_KEYS
from mecazen.schema import LIVE
from msgspec import inspect as types

WIDE = 1e9
"""Bounds of this magnitude only exclude infinity; they are not shown."""
ALWAYS = {"--help", "--install-completion", "--show-completion"}
"""Options that need no row."""
SHARED = 3
"""An option of at least this number of commands is described once."""
HEAD = "| key | type | default | meaning |\n| --- | --- | --- | --- |"


def configuration() -> str:
    """Return a chapter for each table of a scenario, with a row for each of its keys."""
    return "\n\n".join(_Chapters().write(Scenario))


class _Chapters:
    """The structs of a scenario, each described where it is met first."""

    def __init__(self) -> None:
        self._titles: dict[type, str] = {}
        self._queue: list[type] = []

    def write(self, root: type) -> Iterator[str]:
        self._titles[root] = "top level"
        self._queue = [root]
        while self._queue:
            struct = self._queue.pop(0)
            kind = types.type_info(struct)
            assert isinstance(kind, types.StructType)
            before = len(self._queue)
            rows = [self._row(struct, field) for field in kind.fields if field.name not in NO_KEYS]
            if kind.tag_field:
                choice = (f"`{kind.tag_field}`", f'`"{kind.tag}"`', "", "selects this table")
                rows.insert(0, _cells(*choice))
            if struct is not root:  # a table's own tables come next
                found = self._queue[before:]
                self._queue = found + self._queue[:before]
            yield "\n\n".join(
                (f"## {self._titles[struct]}", _about(struct), "\n".join((HEAD, *rows)))
            )

    def _row(self, struct: type, field: types.Field) -> str:
        title = "" if struct is Scenario else f"{self._titles[struct].partition(',')[0]}."
        kind, live = _bare(field.type)
        words = self._words(kind, f"{title}{field.encode_name}")
        if live:
            words += ", live"
        meaning = _docs(struct).get(field.name, "")
        return _cells(f"`{field.encode_name}`", words, _default(field), meaning)

    def _words(self, kind: types.Type, key: str) -> str:
        """Return a type in words; a struct that is new gets a chapter with `key` as title."""
        kind, _ = _bare(kind)
        match kind:
            case types.StructType():
                return self._link(kind, key)
            case types.UnionType():
                words = [self._words(one, key) for one in kind.types]
                return " or ".join(dict.fromkeys(words))
            case types.LiteralType():
                return ", ".join(f'`"{value}"`' for value in kind.values)
            case types.VarTupleType() | types.ListType():
                return f"list of {self._words(kind.item_type, key)}"
            case types.TupleType():
                return f"[{', '.join(self._words(one, key) for one in kind.item_types)}]"
            case types.DictType():
                return f"table of {self._words(kind.value_type, key)}"
            case types.FloatType():
                return f"number{_range(kind)}"
            case types.IntType():
                return f"integer{_range(kind)}"
            case types.CustomType():
                return "folder" if kind.cls.__name__ == "Folder" else "file"
        plain = {types.BoolType: "`true`, `false`", types.StrType: "text", types.NoneType: "none"}
        return plain.get(type(kind), "any value")

    def _link(self, kind: types.StructType, key: str) -> str:
        if kind.cls not in self._titles:
            title = key if kind.tag is None else f"{key}, kind {kind.tag}"
            self._titles[kind.cls] = title
            self._queue.append(kind.cls)
        title = self._titles[kind.cls]
        return f"[{kind.tag or 'table'}](#{_anchor(title)})"


def commands(app: typer.Typer) -> str:
    """Return a chapter for each command of `mecazen`, with its arguments and options."""
    found = list(_walk(typer.main.get_command(app), "mecazen"))
    counts = Counter(row for _, command in found for row in _rows(command))
    shared = sorted(row for row, count in counts.items() if count >= SHARED)
    parts = ["## Options of several commands", _table(shared)]
    for name, command in found:
        rows = _rows(command)
        parts += [f"## {name}", _help(command.help or "")]
        parts += [_table(own)] if (own := [row for row in rows if row not in shared]) else []
        if both := [row.split(" | ")[0].strip("| ") for row in rows if row in shared]:
            parts.append(f"[Shared](#options-of-several-commands): {', '.join(both)}.")
    return "\n\n".join(parts)


def _walk(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    yield name, command
    for part, inner in sorted(getattr(command, "commands", {}).items()):
        yield from _walk(inner, f"{name} {part}")


def _rows(command: Any) -> list[str]:
    return [_option(one) for one in command.params if not ALWAYS & set(one.opts)]


def _table(rows: list[str]) -> str:
    return "\n".join(("| option | default | meaning |", "| --- | --- | --- |", *rows))


def _option(one: Any) -> str:
    if one.param_type_name == "argument":
        name = one.metavar or one.name.upper()
    else:
        value = "" if one.is_flag else f" {one.metavar or _value(one.type_descriptor.annotation)}"
        name = ", ".join(one.opts) + value
    shown = one.show_default
    if one.required:
        default = "required"
    elif isinstance(shown, str):
        default = shown.replace("<", "&lt;")
    elif shown and one.default not in (None, False, ()):
        default = f"`{one.default}`"
    else:
        default = ""
    return _cells(f"`{name}`", default, _line(one.help or ""))


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
    return " " + ", ".join(words) if words else ""


def _default(field: types.Field) -> str:
    if field.required:
        return "required"
    value = field.default
    if value is msgspec.NODEFAULT:
        value = field.default_factory() if callable(field.default_factory) else None
    if value is None:
        return ""
    if isinstance(value, msgspec.Struct):
        tag = value.__struct_config__.tag
        return f"`{tag}`" if tag else ""
    return f"`{json.dumps(msgspec.to_builtins(value, enc_hook=str))}`"


def _about(struct: type) -> str:
    return _paragraphs(inspect.getdoc(struct) or "")


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
