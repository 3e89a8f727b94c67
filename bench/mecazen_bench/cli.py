"""`mecazen bench`: speed and accuracy of the simulator."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer
from mecazen_tools.cli.options import console
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
            metavar="BENCHMARK",
            help="Measure one benchmark; may be given several times. Measured only on request, "
            "since they take minutes: peers, steps, experiments, flood, malformed, containers.",
            show_default=False,
        ),
    ] = None,
    payloads: Annotated[
        int | None,
        typer.Option(
            min=1000,
            help="Of the benchmark malformed: so many for the services in this process, and as "
            "many for each of two stacks, open and secured.",
            show_default="1000000 and 100000",
        ),
    ] = None,
    minutes: Annotated[
        float,
        typer.Option(
            min=0.0,
            help="Of the benchmark malformed: each of the three ends after so long.",
            show_default="no end",
        ),
    ] = math.inf,
    json: Annotated[
        Path | None,
        typer.Option(
            "--json",
            metavar="FILE",
            help="Write all figures here.",
            show_default="bench/results/<machine>.json; with --only, <machine>-<benchmark>.json",
        ),
    ] = None,
) -> None:
    """Measure in rounds of interleaved benchmarks; print and write medians and quartiles.

    Examples: mecazen bench run · mecazen bench run --only physics --only loop
    """
    from mecazen_bench import benchmarks, results  # noqa: PLC0415

    chosen = benchmarks.select(only or (), payloads=payloads, minutes=minutes)
    with Console(stderr=True).status("") as status:
        found = benchmarks.measure(chosen, lambda what: status.update(f"measuring {what} …"))
    terminal = console(WIDTH)
    terminal.print(found.table())
    for group in found.groups:
        terminal.print(f"[dim]{group.title}: {group.how}[/]")
    took = ", ".join(f"{name} {one.seconds:.0f} s" for name, one in found.benchmarks.items())
    terminal.print(f"{found.context()}\ntook {took}")
    path = json or results.default_path(found.machine.name, list(chosen) if only else [])
    results.write(found, path)
    terminal.print(f"figures: {path}")


@app.command()
def compare(before: File, after: File) -> None:
    """Show each figure of two results, their ratio, and which became worse or better.

    A figure counts as worse or better where its medians differ by more than the sum of both
    interquartile ranges. The exit code is 1 where a figure became worse.

    Example: mecazen bench compare before.json after.json
    """
    from mecazen_bench import results  # noqa: PLC0415
    from mecazen_bench.compare import compare, notes, table  # noqa: PLC0415

    earlier, later = results.read(before), results.read(after)
    changes = compare(earlier, later)
    terminal = console(WIDTH)
    terminal.print(table(changes), *notes(earlier, later), sep="\n")
    worse = sum(change.verdict == "worse" for change in changes)
    terminal.print(f"{worse} of {len(changes)} figures became worse")
    raise typer.Exit(1 if worse else 0)


@app.command()
def tables() -> None:
    """Write the tables of docs/performance.md from the files in bench/results."""
    from mecazen_bench.results import DOCUMENT, updated  # noqa: PLC0415

    DOCUMENT.write_text(updated(DOCUMENT.read_text()))


@app.command()
def soak(
    hours: Annotated[float, typer.Option(help="Simulated time in lockstep.")] = 2.0,
    minutes: Annotated[float, typer.Option(help="Real time.")] = 10.0,
) -> None:
    """Run for hours; check that memory does not grow, no tick is lost, and time does not drift.

    The exit code is 1 where one of these fails.
    """
    from mecazen_bench import soak  # noqa: PLC0415

    passed = [soak.lockstep(hours), soak.real_time(minutes)]
    raise typer.Exit(0 if all(passed) else 1)
