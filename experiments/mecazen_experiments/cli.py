"""`mecazen experiment`: many runs, their scores, tables and figures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from mecazen_tools.cli.options import Settings
from typer import Argument, Option

app = typer.Typer(no_args_is_help=True, help="Run scenarios many times and score them.")

FILE_HELP = "A TOML file, or its name in configs/experiments."
DASK_HELP = "Send the runs to this Dask scheduler; start its workers with --nthreads 1."
SWEEP_HELP = "Run every case with each of these values. May be given several times."
WALKS_HELP = "Run cases of a recorded walk with each CSV in this folder."

File = Annotated[str, Argument(metavar="FILE", help=FILE_HELP, show_default=False)]
Files = Annotated[
    list[str],
    Argument(metavar="FILE…", help=f"{FILE_HELP} Several make one table.", show_default=False),
]
RUNS_HELP = "Seeds 1, 2, … for each case."
Runs = Annotated[
    int | None, Option(min=1, max=1_000_000, help=RUNS_HELP, show_default="experiment's")
]
Jobs = Annotated[
    int | None, Option(min=1, help="Processes on this machine.", show_default="one for each core")
]
Scheduler = Annotated[str | None, Option(metavar="ADDRESS", help=DASK_HELP, show_default=False)]
Store = Annotated[Path, Option(metavar="FILE", help="Where results are kept; SQLite.")]
Json = Annotated[
    Path | None,
    Option("--json", metavar="FILE", help="Write all scores of all runs.", show_default=False),
]
Walks = Annotated[Path | None, Option(metavar="FOLDER", help=WALKS_HELP, show_default=False)]
Sweep = Annotated[
    list[str] | None, Option(metavar="KEY=V1,V2", help=SWEEP_HELP, show_default=False)
]
Situations = Annotated[list[str] | None, Option(help="One of its situations.", show_default="all")]
Drivers = Annotated[list[str] | None, Option(help="One of its drivers.", show_default="all")]
Films = Annotated[
    Path | None,
    Option(metavar="FOLDER", help="Record the first run of each there: MCAP.", show_default="none"),
]
DefaultFile = Annotated[str, Argument(metavar="FILE", help=FILE_HELP)]
View = Annotated[list[str] | None, Option(help="One of its views.", show_default="all")]
Standoffs = Annotated[
    list[float] | None, Option(min=0.1, help=r"Distance to the person \[m].", show_default="all")
]
Speeds = Annotated[
    list[float] | None, Option(min=0.05, help=r"Of the person \[m/s].", show_default="all")
]
MocapFigures = Annotated[
    Path | None, Option(metavar="FOLDER", help="Draw its figures there.", show_default="none")
]
STORE = Path("experiments.sqlite")

# Each command imports what it needs itself: every start of `mecazen` imports this module.


@app.command()
def run(
    files: Files,
    settings: Settings = None,
    sweep: Sweep = None,
    walks: Walks = None,
    runs: Runs = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
    verbose: Annotated[bool, Option("--verbose", help="Show each walk.")] = False,
) -> None:
    """Run the cases of experiments, each with many seeds, and score them.

    Finished runs are kept: after Ctrl-C the same command continues from there.

    Examples: mecazen experiment run table2 --runs 5 ·
    mecazen experiment run table2 --sweep follower.standoff_m=1,1.5 --json out.json
    """
    from mecazen_experiments import commands  # noqa: PLC0415

    options = commands.Options(jobs, scheduler, store, json)
    commands.run(options, files, tuple(settings or ()), sweep or (), walks, runs, verbose=verbose)


@app.command()
def tune(
    file: File,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
) -> None:
    """Search for the best settings on some seeds, and report them on others.

    The search is deterministic; after Ctrl-C the same command continues from there.
    """
    from mecazen_experiments import commands  # noqa: PLC0415

    commands.tune(commands.Options(jobs, scheduler, store, json), file)


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

    commands.table2(commands.Options(jobs, scheduler, store, json), runs)


@app.command()
def budget(
    file: File,
    walks: Walks = None,
    runs: Runs = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
) -> None:
    """Show the error budget of an experiment: the parts of control, filter and sensor.

    Every run is repeated with an oracle that knows the true person, and the observations are
    smoothed with all later ones.
    """
    from mecazen_experiments import commands  # noqa: PLC0415

    commands.budget(commands.Options(jobs, scheduler, store, json), file, runs, walks)


@app.command()
def mocap(
    file: DefaultFile = "mocap",
    settings: Settings = None,
    view: View = None,
    standoff: Standoffs = None,
    speed: Speeds = None,
    runs: Runs = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
    out: MocapFigures = None,
) -> None:
    """Score how well the robot captures a gait, by view, standoff and walking speed.

    Finished runs are kept: after Ctrl-C the same command continues from there.

    Example: mecazen experiment mocap --view back --standoff 1.5 --standoff 2 --speed 1
    """
    from mecazen_experiments import commands  # noqa: PLC0415
    from mecazen_experiments.mocap import configured  # noqa: PLC0415

    config = configured(file, view or (), standoff or (), speed or ())
    options = commands.Options(jobs, scheduler, store, json)
    commands.mocap(options, config, tuple(settings or ()), runs, out)


@app.command()
def safety(
    file: DefaultFile = "safety",
    settings: Settings = None,
    situation: Situations = None,
    driver: Drivers = None,
    view: View = None,
    runs: Runs = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
    films: Films = None,
) -> None:
    """Score how safely the robot follows: situations, each with several drivers and views.

    Finished runs are kept: after Ctrl-C the same command continues from there.

    Example: mecazen experiment safety --situation "hard stop" --driver guard --runs 3
    """
    from mecazen_experiments import commands  # noqa: PLC0415
    from mecazen_experiments.safety import configured  # noqa: PLC0415

    config = configured(file, situation or (), driver or (), view or ())
    options = commands.Options(jobs, scheduler, store, json)
    commands.safety(options, config, tuple(settings or ()), runs, films)


@app.command()
def fuzz(
    hours: Annotated[float, Option(min=0.01, max=10000, help="Simulated time.")] = 0.2,
    seed: Annotated[int, Option(min=0, help="Of the first minute; each has the next.")] = 1,
    physics: Annotated[bool, Option("--physics", help="In DART, not in a plane.")] = False,
    follower: Annotated[bool, Option("--follower", help="A follower drives, not chance.")] = False,
    freezes: Annotated[bool, Option("--freezes", help="Services freeze now and then.")] = False,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
) -> None:
    """Drive a guarded robot at random among things and a person, and count what it touches.

    Each simulated minute is another room. It fails if the robot touches anything.
    Finished minutes are kept: after Ctrl-C the same command continues from there.
    """
    from mecazen_experiments import commands  # noqa: PLC0415

    minutes = range(seed, seed + max(1, round(hours * 60.0)))
    options = commands.Options(jobs, scheduler, store, json)
    commands.fuzz(options, minutes, physics=physics, follower=follower, freezes=freezes)


@app.command()
def figures(
    out: Annotated[Path, Option(metavar="FOLDER", help="Where to write them.")] = Path("figures"),
    seed: Annotated[int, Option(min=0, max=2**32 - 1, help="Of the runs shown.")] = 1,
) -> None:
    """Draw the paper's figures from runs of the four cases of its Table II."""
    from mecazen_experiments import commands  # noqa: PLC0415

    commands.figures(out, seed)
