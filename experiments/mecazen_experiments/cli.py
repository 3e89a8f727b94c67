"""`mecazen experiment`: many runs, their scores, tables and figures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from mecazen_tools.cli.options import Settings
from typer import Argument, Option

app = typer.Typer(no_args_is_help=True, help="Run scenarios many times and score them.")

# Each command imports what it needs itself: every start of `mecazen` imports this module.


@app.command()
def run(
    study: Annotated[
        str,
        Argument(
            metavar="STUDY",
            help="A TOML file, or its name in configs/experiments.",
            show_default=False,
        ),
    ],
    seeds: Annotated[
        str | None,
        Option(metavar="N-M", help="Seeds: a range or a list.", show_default="study's"),
    ] = None,
    settings: Settings = None,
    sweep: Annotated[
        list[str] | None,
        Option(
            metavar="KEY=V1,V2",
            help="Run every case with each of these values. Repeatable.",
            show_default=False,
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        Option(
            metavar="AXIS=NAME",
            help="Run only one case or other choice of the study, e.g. case='hard stop' or "
            "view=back. Repeatable.",
            show_default="all",
        ),
    ] = None,
    walks: Annotated[
        Path | None,
        Option(
            metavar="FOLDER",
            help="Run cases of a recorded walk with each CSV file of this folder.",
            show_default=False,
        ),
    ] = None,
    jobs: Annotated[
        int | None,
        Option(min=1, help="Processes on this machine.", show_default="one for each core"),
    ] = None,
    cluster: Annotated[
        str | None,
        Option(
            metavar="ADDRESS",
            help="Send the runs to this Dask scheduler; start its workers with --nthreads 1.",
            show_default=False,
        ),
    ] = None,
    store: Annotated[Path, Option(metavar="FILE", help="SQLite file of the results.")] = Path(
        "experiments.sqlite"
    ),
    csv: Annotated[
        Path | None, Option(metavar="FILE", help="Write a row per run.", show_default=False)
    ] = None,
    figures: Annotated[
        Path | None,
        Option(
            metavar="FOLDER", help="Draw the study's figures in this folder.", show_default="none"
        ),
    ] = None,
) -> None:
    """Run the cases of a study, each with many seeds, and show the tables.

    Finished runs are kept: after Ctrl-C the same command continues from there.

    Examples: mecazen experiment run table2 --seeds 1-5 ·
    mecazen experiment run targets --sweep follower.standoff_m=1,1.5 --csv runs.csv ·
    mecazen experiment run safety --only case=door --only driver=guard --seeds 1-3
    """
    from mecazen_experiments import commands  # noqa: PLC0415

    workers = commands.choose_workers(jobs, cluster)
    planned = commands.plan(study, seeds, walks, settings or (), sweep or (), only or ())
    commands.run(*planned, workers, store, csv, figures)
