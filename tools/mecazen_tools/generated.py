"""Write the files that are generated from the code: `make graph`.

The access rules, files of installed bridges, and the tables in documents between
`<!-- graph: NAME -->` and `<!-- /graph -->`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from mecazen.bridges import installed
from mecazen.graph import GRAPH, Graph

from mecazen_tools.access import access_table, secure_json5
from mecazen_tools.cli.app import app
from mecazen_tools.graph_views import keys_table, nodes_table
from mecazen_tools.references import commands, configuration

DOCUMENTS = ("docs/keys.md", "docs/configuration.md", "docs/architecture.md", "docs/deploy.md")
COMMANDS = "docs/cli.md"
"""The reference of commands; all projects that provide commands must be installed."""
_REGION = re.compile(r"(<!-- graph: (\w+) -->\n).*?(<!-- /graph -->)", re.DOTALL)


def files(root: Path) -> Iterator[tuple[Path, str]]:
    """Yield each file that is generated from the graph, and its required content."""
    graph = Graph(GRAPH)
    tables = {
        "keys": keys_table(graph),
        "nodes": nodes_table(graph),
        "access": access_table(),
        "configuration": configuration(),
    }
    yield root / "configs" / "zenoh" / "secure.json5", secure_json5()
    for bridge in installed():
        yield from bridge.files(root)
    for name in DOCUMENTS:
        yield root / name, _filled(root / name, tables)


def command_reference(root: Path) -> tuple[Path, str]:
    """Return the reference of the commands that are installed, and its required content."""
    return root / COMMANDS, _filled(root / COMMANDS, {"commands": commands(app)})


def _filled(path: Path, tables: dict[str, str]) -> str:
    """Return a document with its tables."""
    return _REGION.sub(lambda m: f"{m[1]}{tables[m[2]]}\n{m[3]}", path.read_text())


def main() -> None:
    """Write the files below the working directory."""
    for path, text in (*files(Path.cwd()), command_reference(Path.cwd())):
        if not path.exists() or path.read_text() != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
            print(f"{path.relative_to(Path.cwd())}: written")


if __name__ == "__main__":
    main()
