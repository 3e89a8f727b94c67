"""`mecazen bench`: how fast and how right the simulator is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

app = typer.Typer(
    no_args_is_help=True, help="Measure speed, accuracy and latency, and compare results."
)

WIDTH = 120
"""Of the tables [characters] where the output is no terminal."""

File = Annotated[Path, typer.Argument(metavar="FILE.json", show_default=False)]

# Each command imports what it needs itself: every start of `mecazen` imports this module.


@app.command()
def run(
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART",
            help="Measure one part; may be given several times. Those that take minutes are "
            "measured only so: peers, experiments, flood, malformed, containers.",
            show_default=False,
        ),
    ] = None,
    json: Annotated[
        Path | None,
        typer.Option(
            "--json",
            metavar="FILE",
            help="Write all figures here.",
            show_default="bench/results/<machine>.json, and of parts alone <machine>-<part>.json",
        ),
    ] = None,
) -> None:
    """Measure in rounds in which all parts take turns; print and write medians and quartiles.

    Examples: mecazen bench run · mecazen bench run --only physics --only loop
    """
    from mecazen.errors import MecazenError  # noqa: PLC0415

    from mecazen_bench import parts, results  # noqa: PLC0415

    for name in only or ():
        if name not in parts.PARTS:
            raise MecazenError(f"--only {name}: no such part; there are {', '.join(parts.PARTS)}")
    chosen = {
        name: part
        for name, part in parts.PARTS.items()
        if (name in only if only else not part.on_demand)
    }
    with Console(stderr=True).status("") as status:
        found = parts.measure(chosen, lambda what: status.update(f"measuring {what} …"))
    console = _console()
    console.print(found.table())
    for group in found.groups:
        console.print(f"[dim]{group.title}: {group.how}[/]")
    took = ", ".join(f"{name} {seconds:.0f} s" for name, seconds in found.seconds.items())
    console.print(f"{found.text()}\ntook {took}")
    path = json or results.default_path(found.machine, list(chosen) if only else [])
    results.write(found, path)
    console.print(f"figures: {path}")


@app.command()
def compare(before: File, after: File) -> None:
    """Show each figure of two results, their ratio, and what became worse or better.

    That is said of a figure whose medians differ by more than the quartiles of both lie apart.
    Ends with 1 where something became worse.

    Example: mecazen bench compare before.json after.json
    """
    from mecazen_bench import results  # noqa: PLC0415
    from mecazen_bench.compare import compare, notes, table  # noqa: PLC0415

    earlier, later = results.read(before), results.read(after)
    changes = compare(earlier, later)
    console = _console()
    console.print(table(changes))
    for line in notes(earlier, later):
        console.print(line)
    worse = sum(change.verdict == "worse" for change in changes)
    console.print(f"{worse} of {len(changes)} figures became worse")
    raise typer.Exit(1 if worse else 0)


@app.command()
def markdown(file: File) -> None:
    """Print results as the tables of docs/performance.md."""
    from mecazen_bench import results  # noqa: PLC0415

    typer.echo(results.read(file).markdown(), nl=False)


def _console() -> Console:
    console = Console()
    return console if console.is_terminal else Console(width=WIDTH)
