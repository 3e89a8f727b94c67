"""`mecazen experiment`: many runs, their scores, tables and figures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from mecazen_tools.cli.options import Settings

app = typer.Typer(no_args_is_help=True, help="Run scenarios many times and score them.")

File = Annotated[
    str,
    typer.Argument(
        metavar="FILE", help="A TOML file, or its name in configs/experiments.", show_default=False
    ),
]
Runs = Annotated[
    int | None,
    typer.Option(
        min=1, max=1_000_000, help="Seeds 1, 2, … for each case.", show_default="the experiment's"
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(min=1, help="Processes on this machine.", show_default="one for each core"),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Send the runs to the Dask cluster of this scheduler instead; start its workers "
        "with --nthreads 1.",
        show_default=False,
    ),
]
Store = Annotated[Path, typer.Option(metavar="FILE", help="Where results are kept; SQLite.")]
Json = Annotated[
    Path | None,
    typer.Option(
        "--json", metavar="FILE", help="Write all scores of all runs.", show_default=False
    ),
]
Walks = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Run cases of a recorded walk with each CSV in this folder.",
        show_default=False,
    ),
]
STORE = Path("experiments.sqlite")

# Each command imports what it needs itself: every start of `mecazen` imports this module.


@app.command()
def run(
    file: File,
    settings: Settings = None,
    sweep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=V1,V2",
            help="Run every case with each of these values. May be given several times.",
            show_default=False,
        ),
    ] = None,
    walks: Walks = None,
    runs: Runs = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Show each walk.")] = False,
) -> None:
    """Run the cases of an experiment, each with many seeds, and score them.

    What is finished is kept: after Ctrl-C the same command goes on from there.

    Examples: mecazen experiment run table2 --runs 5 ·
    mecazen experiment run table2 --sweep follower.standoff_m=1,1.5 --json out.json
    """
    from mecazen_experiments import commands  # noqa: PLC0415

    options = commands.Options(jobs, scheduler, store, json)
    commands.run(file, tuple(settings or ()), sweep or (), walks, runs, options, verbose=verbose)


@app.command()
def tune(
    file: File,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
) -> None:
    """Search for the settings that do best, and report them on seeds that it did not see.

    The search is the same each time; after Ctrl-C the same command goes on from there.
    """
    from mecazen_experiments import commands  # noqa: PLC0415

    commands.tune(file, commands.Options(jobs, scheduler, store, json))


@app.command()
def table2(
    runs: Runs = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
) -> None:
    """Print the paper's Table II with our runs beside it: configs/experiments/table2.toml."""
    from mecazen_experiments import commands  # noqa: PLC0415

    commands.table2(runs, commands.Options(jobs, scheduler, store, json))


@app.command()
def shares(
    file: File,
    walks: Walks = None,
    runs: Runs = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
) -> None:
    """Show who owes what of an experiment's errors: the control, the filter, or the sensor.

    Every run is done again with an oracle that is told where the person is, and what it saw
    is smoothed with all observations at hand.
    """
    from mecazen_experiments import commands  # noqa: PLC0415

    commands.shares(file, runs, walks, commands.Options(jobs, scheduler, store, json))


@app.command()
def figures(
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where to write them.")] = Path(
        "figures"
    ),
    seed: Annotated[int, typer.Option(min=0, max=2**32 - 1, help="Of the runs shown.")] = 1,
) -> None:
    """Draw the paper's figures from runs of the four cases of its Table II."""
    from mecazen_experiments import commands  # noqa: PLC0415
    from mecazen_experiments.figures import draw  # noqa: PLC0415

    commands.figures(draw, out, seed)
