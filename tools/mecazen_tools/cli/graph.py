"""`mecazen graph`: the nodes of a scenario, what they exchange, and in which process."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from mecazen.errors import MecazenError
from mecazen.graph import GRAPH, Graph
from mecazen.programs import graph_of
from rich.table import Table

from mecazen_tools.cli.options import Settings, console, load
from mecazen_tools.generated import one_process_each
from mecazen_tools.graph_views import gives, svg, takes


def graph(
    scenario: Annotated[
        str | None,
        typer.Argument(metavar="[SCENARIO]", help="Its nodes; left out, all that there are."),
    ] = None,
    svg_file: Annotated[
        Path | None, typer.Option("--svg", metavar="FILE", help="Draw the data flow.")
    ] = None,
    settings: Settings = None,
) -> None:
    """Show the nodes, the keys that they take and give with their rates, and the processes.

    Examples: mecazen graph back · mecazen graph back --svg flow.svg
    """
    if scenario is None:
        nodes, processes = Graph(GRAPH), one_process_each()
    else:
        loaded = load(scenario, settings)
        nodes = graph_of(loaded)
        processes = [
            (process.name, [row.name for s in process.services for row in nodes.services[s]])
            for process in loaded.process_plan
            if process.robot in ("", loaded.names[0])
        ]
    if svg_file is not None:
        try:
            svg_file.write_text(svg(nodes, processes))
        except OSError as error:
            raise MecazenError(f"--svg {svg_file}: {error.strerror}") from None
    table = Table("process", "node", "takes", "gives, answers?", "rates")
    for process, names in processes:
        for number, name in enumerate(names):
            row = nodes.row(name)
            rates = ", ".join(f"{key}: {rate}" for key, rate in row.rates.items())
            table.add_row("" if number else process, name, takes(row), gives(row), rates)
        table.add_section()
    console(160).print(table)
