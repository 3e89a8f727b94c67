"""`mecazen bench`: speed and accuracy of the simulator."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer
from mecazen.errors import MecazenError

app = typer.Typer(
    no_args_is_help=True, help="Measure speed, accuracy and latency, and compare results."
)

BENCHMARKS = ("loop", "latency", "realtime", "physics", "environments")
"""Modules whose function `run` measures one round."""

File = Annotated[Path, typer.Argument(metavar="FILE.csv", show_default=False)]

# Each command imports what it needs itself: every start of `mecazen` imports this module.


@app.command()
def run(
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="BENCHMARK",
            help=f"Measure one of {', '.join(BENCHMARKS)}. Repeatable.",
            show_default="all",
        ),
    ] = None,
    rounds: Annotated[int, typer.Option(min=1, help="Rounds of each benchmark.")] = 3,
    csv: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write all figures to this file, for `compare`.",
            show_default="none",
        ),
    ] = None,
) -> None:
    """Run benchmarks in interleaved rounds; print and write medians and quartiles.

    Examples: mecazen bench run --csv before.csv · mecazen bench run --only physics --only loop
    """
    from mecazen_bench import harness  # noqa: PLC0415

    chosen = only or BENCHMARKS
    if unknown := set(chosen) - set(BENCHMARKS):
        known = ", ".join(BENCHMARKS)
        raise MecazenError(f"--only {min(unknown)}: no such benchmark; there are {known}")
    figures = harness.measure(
        {name: import_module(f"mecazen_bench.{name}").run for name in chosen},
        rounds,
        lambda line: typer.echo(f"measuring {line}", err=True),
    )
    for title, table in harness.tables(figures).items():
        typer.echo(f"{title}\n\n{table}")
    typer.echo(harness.machine())
    if csv is not None:
        harness.write(figures, csv)


@app.command()
def compare(before: File, after: File) -> None:
    """Show figures of two results with their ratios, and mark worse and better ones.

    A figure is worse or better if its medians differ by more than the sum of both
    interquartile ranges. The exit code is 1 if any figure is worse.

    Example: mecazen bench compare before.csv after.csv
    """
    from mecazen_bench import harness  # noqa: PLC0415

    table, worse = harness.compare(harness.read(before), harness.read(after))
    typer.echo(f"{table}\n{worse} figures became worse")
    raise typer.Exit(1 if worse else 0)
