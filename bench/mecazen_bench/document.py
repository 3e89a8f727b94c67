"""The tables of docs/performance.md, generated from results files.

A block begins with `<!-- bench: NAME -->` and ends with `<!-- /bench -->`. NAME is a benchmark,
`machine` or `optimisations`.
"""

from __future__ import annotations

import re
from pathlib import Path

from mecazen_bench.figures import Name, markdown_table, named
from mecazen_bench.results import FOLDER, Results, ResultsError, default_path, read

DOCUMENT = FOLDER.parents[1] / "docs" / "performance.md"
MACHINE = "intel-xeon-processor-2-cores"
"""The machine whose results are in the document."""
BLOCK = re.compile(r"(<!-- bench: (\S+) -->\n).*?(<!-- /bench -->)", re.DOTALL)

DISTRIBUTED: Name = ("Whole loop: scenario back", "distributed", "ticks/s")
LATENCY = "Latency from cmd_vel to joint_command: scenario teleop"
OPTIMISATIONS: dict[str, tuple[str, Name]] = {
    "thread-state": ("Python thread state held by Zenoh's threads", DISTRIBUTED),
    "batch-core": ("SCHED_BATCH on one shared core", DISTRIBUTED),
    "gathering": ("samples gathered in the collector", DISTRIBUTED),
    "priority": ("real-time priority and one core", (LATENCY, "all cores busy", "p99 ms")),
    "gc-freeze": ("garbage collector frozen", (LATENCY, "idle", "p99 ms")),
    "openblas": (
        "one OpenBLAS thread",
        ("Start and schedule: scenario back in real time", "mecazen up", "first odom s"),
    ),
}
"""Description and figure of what makes the simulator faster.

The results without NAME are in `<machine>-without-NAME.json`.
"""


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
    if name == "optimisations":
        return _optimisations(main, folder)
    path = default_path(MACHINE, [name], folder)
    results = read(path) if path.exists() else main
    if name not in results.benchmarks:
        return f"Not measured yet: `mecazen bench run --only {name}`.\n"
    tables = [group.markdown() for group in results.benchmarks[name].groups]
    if results is not main:
        tables.append(f"{results.context()}\n")
    return "\n".join(tables)


def _optimisations(main: Results, folder: Path) -> str:
    figures = dict(named(main.groups))
    rows = [["optimisation", "figure", "without", "with", "gain"]]
    for slug, (description, name) in OPTIMISATIONS.items():
        path = default_path(MACHINE, ["without", slug], folder)
        cells = ["", "", "not measured yet"]
        if path.exists():
            before, after = dict(named(read(path).groups)).get(name), figures.get(name)
            if before is None or after is None:
                raise ResultsError(f"{path}: no figure {' / '.join(name)}")
            ratio = after.value / before.value
            gain = ratio if after.better == "more" else 1.0 / ratio
            cells = [before.texts()[0], after.texts()[0], f"{gain:.2f}"]
        rows.append([description, " / ".join(name), *cells])
    return markdown_table(rows)
