"""`mecazen bench`: speed and accuracy of the simulator."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from mecazen.errors import MecazenError

if TYPE_CHECKING:
    from mecazen_bench.harness import Group

app = typer.Typer(
    no_args_is_help=True, help="Measure speed, accuracy and latency, and compare results."
)

BENCHMARKS = {
    "physics": "physics:run",
    "robots": "robots:run",
    "loop": "loop:run",
    "senses": "loop:run_senses",
    "safety": "loop:run_safety",
    "latency": "latency:run",
    "realtime": "realtime:run",
    "viewer": "realtime:run_viewer",
    "recorder": "recorder:run",
    "ros2": "ros2:run",
    "peers": "physics:run_peers",
    "steps": "physics:run_steps",
    "experiments": "experiments:run",
}
"""Module and function of each benchmark; the function measures one round."""
ON_REQUEST = ("peers", "steps", "experiments")
"""Benchmarks that take minutes."""

File = Annotated[Path, typer.Argument(metavar="FILE.json", show_default=False)]

# Each command imports what it needs itself: every start of `mecazen` imports this module.


def benchmark(name: str) -> Callable[[], list[Group]]:
    """Return the function of a benchmark."""
    if name not in BENCHMARKS:
        raise MecazenError(f"--only {name}: no such benchmark; there are {', '.join(BENCHMARKS)}")
    module, _, function = BENCHMARKS[name].partition(":")
    found: Callable[[], list[Group]] = getattr(import_module(f"mecazen_bench.{module}"), function)
    return found


@app.command()
def run(
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="BENCHMARK",
            help="Measure one benchmark; may be given several times. Measured only on request, "
            f"since they take minutes: {', '.join(ON_REQUEST)}.",
            show_default=False,
        ),
    ] = None,
    rounds: Annotated[int, typer.Option(min=1, help="Rounds of each benchmark.")] = 3,
    json: Annotated[
        Path | None,
        typer.Option(
            "--json",
            metavar="FILE",
            help="Write all figures here, for `compare`.",
            show_default="none",
        ),
    ] = None,
) -> None:
    """Measure in rounds of interleaved benchmarks; print and write medians and quartiles.

    Examples: mecazen bench run --json before.json · mecazen bench run --only physics --only loop
    """
    from mecazen_bench import harness  # noqa: PLC0415

    chosen = only or [name for name in BENCHMARKS if name not in ON_REQUEST]
    found = harness.measure(
        {name: benchmark(name) for name in chosen},
        rounds,
        lambda what: typer.echo(f"measuring {what}", err=True),
    )
    for groups in found.benchmarks.values():
        typer.echo("\n".join(str(group.table()) for group in groups))
    typer.echo(found.context)
    if json is not None:
        harness.write(found, json)


@app.command()
def compare(before: File, after: File) -> None:
    """Show each figure of two results, their ratio, and which became worse or better.

    A figure counts as worse or better where its medians differ by more than the sum of both
    interquartile ranges. The exit code is 1 where a figure became worse.

    Example: mecazen bench compare before.json after.json
    """
    from mecazen_bench import harness  # noqa: PLC0415

    earlier, later = harness.read(before), harness.read(after)
    table, worse = harness.compare(earlier, later)
    typer.echo(f"{table}\nbefore: {earlier.context}\nafter: {later.context}")
    typer.echo(f"{worse} figures became worse")
    raise typer.Exit(1 if worse else 0)


@app.command()
def results(
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="STAGE", help="Repeatable.", show_default="all"),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Dask's, for the runs of experiments.", show_default=False
        ),
    ] = None,
) -> None:
    """Run the stages of results/stages.toml that are not up to date, and write their tables.

    After Ctrl-C the same command continues: `make results ONLY=table2`.
    """
    from mecazen_bench import results as stages  # noqa: PLC0415

    options = {} if scheduler is None else {"--scheduler": scheduler}
    stages.run(stages.ROOT, only or (), options, lambda what: typer.echo(what, err=True))


@app.command()
def tables() -> None:
    """Write the tables of README and docs from the files in results."""
    from mecazen_bench import results as stages  # noqa: PLC0415

    stages.write_tables(stages.ROOT)


@app.command()
def check(
    *, release: Annotated[bool, typer.Option("--release", help="Refuse what is stale.")] = False
) -> None:
    """Check that each table and picture of README and docs is what its origin says.

    Results that are older than the last change of their inputs are printed as stale.
    """
    from mecazen_bench import results as stages  # noqa: PLC0415

    wrong, stale = list(stages.problems(stages.ROOT)), list(stages.stale(stages.ROOT))
    typer.echo("\n".join((*wrong, *(f"stale: {one}" for one in stale))))
    raise typer.Exit(1 if wrong or (release and stale) else 0)
