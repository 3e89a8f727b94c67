"""Write the references that come from the code: `make graph`.

These are the tables in documents between `<!-- graph: NAME -->` and `<!-- /graph -->`, the access
rules, and the package of ROS messages.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import typer
from mecazen.config import Scenario
from mecazen.explain import describe
from mecazen.files import to_value
from mecazen.graph import GRAPH, Graph
from mecazen.schema import NO_KEYS, is_live, members
from mecazen_people.body.recording import MARKERS
from mecazen_ros.types import package_files
from mecazen_tools.cli.app import app
from mecazen_tools.cli.graph import call_rows, gives, takes, topic_rows
from msgspec import inspect as types

from docs.access import access_table, secure_json5

ROOT = Path(__file__).parents[1]
REGION = re.compile(r"(<!-- graph: (\w+) -->\n).*?(<!-- /graph -->)", re.DOTALL)
SHORTER = (
    (r"^a | that matches \S+", ""),
    (r" (and )?[<>]= -?1000000000\b", ""),  # these bounds only exclude infinity
    (r" and <= 4294967295", ""),
    (r"\[a (.+?)((?:, a \1)+)\]", lambda match: f"{match[0].count(match[1])} × {match[1]}"),
    (r"'(\w+)'", r'`"\1"`'),
    (">=", "≥"),
    ("<=", "≤"),
    (r"≥ (\S+) and ≤ ", r"\1 to "),
)
"""Patterns in the descriptions of values, and their replacements in tables."""


class Setting(NamedTuple):
    """A row of a table of settings."""

    key: str
    default: str
    values: str
    meaning: str
    kinds: str = ""
    """The kinds that have it, where `kind` selects one of several tables."""


def files() -> Iterator[tuple[Path, str]]:
    """Yield each file that comes from the code, and its required content."""
    graph = Graph(GRAPH)
    tables = {
        "keys": keys_table(graph),
        "nodes": nodes_table(graph),
        "access": access_table(),
        "configuration": "\n\n".join(chapters()),
        "markers": markers_table(),
        "commands": "\n\n".join(commands(typer.main.get_command(app), "mecazen")),
    }
    yield ROOT / "configs" / "zenoh" / "secure.json5", secure_json5()
    yield from package_files(ROOT / "ros2" / "mecazen_msgs")
    for name in ("keys", "configuration", "architecture", "deploy", "cli", "motion"):
        page = ROOT / "docs" / f"{name}.md"
        yield page, REGION.sub(lambda m: f"{m[1]}{tables[m[2]]}\n{m[3]}", page.read_text())


def table(head: str, rows: Iterator[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    names = head.split(", ")
    lines = [[cell.replace("|", "\\|") for cell in row] for row in rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (names, ["---"] * len(names), *lines))


def keys_table(graph: Graph) -> str:
    """Return the topics and queries."""
    rows = (*topic_rows(graph), *call_rows(graph))
    cells = ((f"`{key}`", kind.replace("/msg", ""), *cells) for key, kind, *cells in rows)
    return table("key, message, rate, from, meaning", cells)


def nodes_table(graph: Graph) -> str:
    """Return the nodes with their inputs and outputs."""
    rows = graph.rows
    cells = ((f"`{row.name}`", row.part_of, takes(row), gives(row), row.summary) for row in rows)
    return table("node, service, takes, gives, what it does", cells)


def markers_table() -> str:
    """Return the names of points in motion files, of the left leg."""
    rows = (
        (system, *(f"`{name.format('L')}`" if name else "" for name in row[:-1]), row.source)
        for system, row in MARKERS.items()
    )
    return table("system, hip, knee, ankle, toe, front of the pelvis, source", rows)


def chapters() -> Iterator[str]:
    """Yield a chapter for each section of a scenario, with a row for each setting."""
    homes: dict[type, str] = {}
    sections = {}
    top = []
    for field in types.type_info(Scenario).fields:  # type: ignore[attr-defined]
        if field.name in NO_KEYS:
            continue
        row = setting(Scenario, field, "")
        if structs := structs_of(field.type):
            sections[field.encode_name] = structs[0]
            link = f"[table](#{field.encode_name})"
            row = row._replace(values=link, meaning=row.meaning or about(structs[0]))
        top.append(row)
    yield f"## top level\n\n{settings_table(top)}"
    for name, struct in sections.items():
        homes[struct.cls] = name
        rows = settings(struct, name, "", homes)
        paragraphs = (inspect.getdoc(struct.cls) or "").partition("\n\nRaises:")[0].split("\n\n")
        yield "\n\n".join((f"## {name}", *map(line, paragraphs), settings_table(rows)))


def settings_table(rows: Sequence[Setting]) -> str:
    """Return settings as a table."""
    cells = ((f"`{row.key}`{row.kinds}", *row[1:4]) for row in rows)
    return table("key, default, values, meaning", cells)


def settings(
    struct: types.StructType, section: str, prefix: str, homes: dict[type, str]
) -> list[Setting]:
    """Return the settings of a struct and of the structs in it.

    Args:
        struct: The struct.
        section: The section that has the struct.
        prefix: The first part of the keys.
        homes: The key of each struct that already has a table; other tables link to it.
    """
    rows = []
    for field in struct.fields:
        row = setting(struct.cls, field, prefix)
        structs = structs_of(field.type)
        if structs and (home := homes.get(structs[0].cls)):
            row = row._replace(values=f"as [{home}](#{home.partition('.')[0]})")
            structs = []
        elif len(structs) == 1:
            row = row._replace(meaning=f"{row.meaning} {about(structs[0])}".strip())
        rows.append(row)
        homes |= {kind.cls: f"{section}.{row.key}" for kind in structs}
        kinds: dict[Setting, list[str]] = {}
        for kind in structs:
            if kind.tag:
                tag = Setting(f"{row.key}.kind", "", f'`"{kind.tag}"`', about(kind))
                kinds[tag] = []
            for inner in settings(kind, section, f"{row.key}.", homes):
                kinds.setdefault(inner, []).append(str(kind.tag))
        rows += [inner for inner, tags in kinds.items() if not tags]
        rows += [inner for inner, tags in kinds.items() if len(tags) == len(structs)]
        rows += [
            inner._replace(kinds=f" ({', '.join(tags)})")
            for inner, tags in kinds.items()
            if 0 < len(tags) < len(structs)
        ]
    return rows


def setting(struct: type, field: types.Field, prefix: str) -> Setting:
    """Return the row of a field of a struct."""
    structs = structs_of(field.type)
    is_list = structs and structs != [*members(field.type)]
    key = f"{prefix}{field.encode_name}{'[]' if is_list else ''}"
    values = describe(field.type)
    for pattern, replacement in SHORTER:
        values = re.sub(pattern, replacement, values)
    values += ", *live*" if is_live(field.type) else ""
    return Setting(key, default_of(field), values, meanings(struct).get(field.name, ""))


def default_of(field: types.Field) -> str:
    """Return the default of a field."""
    if field.required:
        return "required"
    value = field.default
    if callable(field.default_factory):
        value = field.default_factory()
    if isinstance(value, msgspec.Struct):
        return f'`"{value.__struct_config__.tag}"`' if value.__struct_config__.tag else ""
    return "none" if value is None else f"`{to_value(msgspec.to_builtins(value, enc_hook=str))}`"


def structs_of(kind: types.Type) -> list[types.StructType]:
    """Return the structs that a type or the items of a list consist of."""
    lists = types.VarTupleType | types.ListType
    parts = [part for part in members(kind) if isinstance(part, lists)]
    kinds = members(parts[0].item_type) if parts else members(kind)
    return [part for part in kinds if isinstance(part, types.StructType)]


def about(struct: types.StructType) -> str:
    """Return the first paragraph of the description of a struct."""
    return line((inspect.getdoc(struct.cls) or "").partition("\n\n")[0])


@cache
def meanings(struct: type) -> dict[str, str]:
    """Return the docstring of each field of a struct."""
    texts: dict[str, str] = {}
    for base in reversed(struct.__mro__):
        if base.__module__.startswith("mecazen"):
            (definition,) = ast.parse(inspect.getsource(base)).body
            assert isinstance(definition, ast.ClassDef)
            for pair in pairwise(definition.body):
                match pair:
                    case (
                        ast.AnnAssign(target=ast.Name(id=name)),
                        ast.Expr(value=ast.Constant(value=str(text))),
                    ):
                        texts[name] = line(text)
    return texts


def commands(command: Any, name: str) -> Iterator[str]:
    """Yield the chapter of a command, and of each command below it."""
    help_text = inspect.cleandoc(re.sub(r"\[/?(bold)?\]", "", command.help or ""))
    text, _, examples = help_text.partition("Example")
    yield f"## {name}"
    yield from map(line, text.strip().split("\n\n"))
    if examples:
        yield "\n".join(("```sh", *line(examples.partition(":")[2]).split(" · "), "```"))
    context = typer.Context(command, info_name=name)
    records = [parameter.get_help_record(context) for parameter in command.params]
    options = [record for record in records if record and "-completion" not in record[0]]
    if options:
        items = "\n".join(f"- `{option}`: {text}" for option, text in options)
        items = re.sub(r" <(str|path|list\[\w+\])>`", "`", items)
        yield re.sub(r"\[default: \((.+?)\)(?=[;\]])", r"[default: \1", items)
    for part, inner in sorted(getattr(command, "commands", {}).items()):
        yield from commands(inner, f"{name} {part}")


def line(text: str) -> str:
    """Return a text in one line."""
    return " ".join(text.split())


def main() -> None:
    """Write the files."""
    for path, text in files():
        if not path.exists() or path.read_text() != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
            print(f"{path.relative_to(ROOT)}: written")


if __name__ == "__main__":
    main()
