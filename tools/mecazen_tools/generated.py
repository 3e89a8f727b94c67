"""Write the files that repeat the graph: `make graph`.

The access rules, the picture of the data flow, files of installed bridges, and the tables in
documents between `<!-- graph: NAME -->` and `<!-- /graph -->`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from mecazen.bridges import installed
from mecazen.config import Process
from mecazen.graph import COLLECTOR, GRAPH, Graph, services

from mecazen_tools.access import access_table, secure_json5
from mecazen_tools.graph_views import keys_table, nodes_table, svg

DOCUMENTS = ("README.md", "docs/architecture.md", "docs/deploy.md")
_REGION = re.compile(r"(<!-- graph: (\w+) -->\n).*?(<!-- /graph -->)", re.DOTALL)


def files(root: Path) -> Iterator[tuple[Path, str]]:
    """Yield each file that is made from the graph, and what it must hold."""
    graph = Graph(GRAPH)
    tables = {"keys": keys_table(graph), "nodes": nodes_table(graph), "access": access_table()}
    yield root / "configs" / "zenoh" / "secure.json5", secure_json5()
    yield root / "docs" / "dataflow.svg", svg(graph, one_process_each())
    for bridge in installed():
        yield from bridge.files(root)
    for name in DOCUMENTS:
        text = (root / name).read_text()
        yield root / name, _REGION.sub(lambda m: f"{m[1]}{tables[m[2]]}\n{m[3]}", text)


def one_process_each() -> list[tuple[str, list[str]]]:
    """Return a process for each service, with its nodes; without the collector."""
    return [
        (Process((name,)).name, [row.name for row in rows])
        for name, rows in services().items()
        if name != COLLECTOR
    ]


def main() -> None:
    """Write the files below the present folder."""
    for path, text in files(Path.cwd()):
        if not path.exists() or path.read_text() != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
            print(f"{path.relative_to(Path.cwd())}: written")


if __name__ == "__main__":
    main()
