"""The tables of docs/performance.md, generated from results files.

A block begins with `<!-- bench: NAME -->` and ends with `<!-- /bench -->`. NAME is a benchmark or
`machine`.
"""

from __future__ import annotations

import re
from pathlib import Path

from mecazen_bench.results import FOLDER, default_path, read

DOCUMENT = FOLDER.parents[1] / "docs" / "performance.md"
MACHINE = "intel-xeon-processor-2-cores"
"""The machine whose results are in the document."""
BLOCK = re.compile(r"(<!-- bench: (\S+) -->\n).*?(<!-- /bench -->)", re.DOTALL)


def updated(document: str, folder: Path = FOLDER) -> str:
    """Return a document with its blocks generated anew from the results in `folder`.

    Raises:
        ResultsError: A results file can't be used.
    """
    return BLOCK.sub(lambda found: f"{found[1]}{_block(found[2], folder)}{found[3]}", document)


def _block(name: str, folder: Path) -> str:
    main = read(default_path(MACHINE, [], folder))
    if name == "machine":
        return f"{main.context()}\n"
    path = default_path(MACHINE, [name], folder)
    results = read(path) if path.exists() else main
    if name not in results.benchmarks:
        return f"Not measured yet: `mecazen bench run --only {name}`.\n"
    tables = [group.markdown() for group in results.benchmarks[name].groups]
    if results is not main:
        tables.append(f"{results.context()}\n")
    return "\n".join(tables)
