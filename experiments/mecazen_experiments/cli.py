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

File = Annotated[str, Argument(metavar="FILE", help=FILE_HELP, show_default=False)]
Walks = Annotated[
    Path | None,
    Option(
        metavar="FOLDER",
        help="Run cases of a recorded walk with each CSV in this folder.",
        show_default=False,
    ),
]
Runs = Annotated[
    int | None,
    Option(
        min=1,
        max=1_000_000,
        help="How many seeds, from the experiment's first one on.",
        show_default="experiment's",
    ),
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
STORE = Path("experiments.sqlite")

# Each command imports what it needs itself: every start of `mecazen` imports this module.


@app.command()
def run(
    files: Annotated[
        list[str],
        Argument(metavar="FILE…", help=f"{FILE_HELP} Several make one table.", show_default=False),
    ],
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
            help="One case or another choice of the experiment, as case='hard stop' or view=back. "
            "Repeatable.",
            show_default="all",
        ),
    ] = None,
    walks: Walks = None,
    runs: Runs = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
    figures: Annotated[
        Path | None,
        Option(metavar="FOLDER", help="Draw the figures of its kind there.", show_default="none"),
    ] = None,
    films: Annotated[
        Path | None,
        Option(
            metavar="FOLDER",
            help="Record the first run of each row there: MCAP.",
            show_default="none",
        ),
    ] = None,
    export: Annotated[
        Path | None,
        Option(
            metavar="FOLDER",
            help="Write the first walk of each row there for gait laboratories: TRC, C3D.",
            show_default="none",
        ),
    ] = None,
    verbose: Annotated[bool, Option("--verbose", help="Show each walk.")] = False,
) -> None:
    """Run the cases of experiments, each with many seeds, and score them.

    Finished runs are kept: after Ctrl-C the same command continues from there.

    Examples: mecazen experiment run table2 --runs 5 ·
    mecazen experiment run targets --sweep follower.standoff_m=1,1.5 --json out.json ·
    mecazen experiment run safety --only case=door --only driver=guard --runs 3
    """
    from mecazen_experiments import commands  # noqa: PLC0415

    commands.run(
        commands.Options(jobs, scheduler, store, json),
        files,
        runs=runs,
        walks=walks,
        settings=settings or (),
        sweep=sweep or (),
        only=only or (),
        verbose=verbose,
        films=films,
        figures=figures,
        export=export,
    )


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

    options = commands.Options(jobs, scheduler, store, json)
    commands.budget(options, file, runs, walks)


@app.command()
def fuzz(
    hours: Annotated[float, Option(min=0.01, max=10000, help="Simulated time.")] = 0.2,
    seed: Annotated[int, Option(min=0, help="Seed of the first minute; each has the next.")] = 1,
    physics: Annotated[bool, Option("--physics", help="In DART, not in a plane.")] = False,
    follower: Annotated[bool, Option("--follower", help="A follower drives, not chance.")] = False,
    freezes: Annotated[bool, Option("--freezes", help="Services freeze now and then.")] = False,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
) -> None:
    """Drive a guarded robot at random among things and a person, and count what it touches.

    Each simulated minute is another room. It fails if the robot touches an obstacle or
    drives at the person when they touch.
    Finished minutes are kept: after Ctrl-C the same command continues from there.
    """
    from mecazen_experiments import commands  # noqa: PLC0415

    minutes = range(seed, seed + max(1, round(hours * 60.0)))
    options = commands.Options(jobs, scheduler, store, json)
    commands.fuzz(options, minutes, physics=physics, follower=follower, freezes=freezes)


@app.command()
def followbench(
    folder: Annotated[
        Path | None,
        Argument(
            metavar="FOLDER",
            help="Episodes of Follow-Bench, as a clone of it has them.",
            show_default="generated ones",
        ),
    ] = None,
    follower: Annotated[
        list[str] | None,
        Option(
            metavar="NAME",
            help="social, window, proportional, braking, ours, or file.py:Class of your own. "
            "Repeatable.",
            show_default="all five",
        ),
    ] = None,
    episodes: Annotated[
        int, Option(min=1, max=1_000_000, help="Generated ones of each cell and place.")
    ] = 20,
    seed: Annotated[
        int, Option(min=0, help="Seed of the first; those below 1000 are for choosing parameters.")
    ] = 1000,
    only: Annotated[
        list[str] | None,
        Option(
            metavar="CLASS",
            help="Circular, Crowd, Parallel, Perpendicular, Corridor, Intersection, Doorway, "
            "Clutter, or a track. Repeatable.",
            show_default="all",
        ),
    ] = None,
    own_robot: Annotated[
        bool, Option("--own-robot", help="The mecanum robot with its senses and the guard.")
    ] = False,
    figures: Annotated[
        Path | None,
        Option(metavar="FOLDER", help="Draw the success in the open there.", show_default="none"),
    ] = None,
    films: Annotated[
        Path | None,
        Option(
            metavar="FOLDER",
            help="Write the first failure of each row there, else its first episode: GIF.",
            show_default="none",
        ),
    ] = None,
    leaderboard: Annotated[
        list[Path] | None,
        Option(
            metavar="FILE",
            help="Play nothing; make one table of such results of --json. Repeatable.",
            show_default="none",
        ),
    ] = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    store: Store = STORE,
    json: Json = None,
) -> None:
    """Follow a person through the episodes of the public benchmark Follow-Bench.

    By default the rules are those of the benchmark: its robot, true positions, any contact fails.
    Finished episodes are kept: after Ctrl-C the same command continues from there.

    Examples: mecazen experiment followbench --follower ours --only Corridor --episodes 5 ·
    mecazen experiment followbench --follower mine.py:Mine --follower ours --json mine.json
    """
    from mecazen_experiments import commands  # noqa: PLC0415

    if leaderboard:
        commands.leaderboard(leaderboard, figures)
        return
    commands.followbench(
        commands.Options(jobs, scheduler, store, json),
        follower or (),
        folder=folder,
        episodes=episodes,
        seed=seed,
        only=only or (),
        own_robot=own_robot,
        figures=figures,
        films=films,
    )


@app.command()
def validate(
    recordings: Annotated[
        Path, Argument(metavar="FOLDER", help="Sessions in OptiOdom's format.", show_default=False)
    ],
    file: Annotated[str, Option("--file", metavar="FILE", help=FILE_HELP)] = "validate",
    out: Annotated[Path, Option(metavar="FOLDER", help="Where to write it.")] = Path("validated"),
) -> None:
    """Compare kinematic models and the full simulation with recordings of a real robot.

    Some sessions are for fitting; the drift from motion capture is that on all others.

    Example: mecazen experiment validate examples/optiodom
    """
    from mecazen_experiments.identify import commands  # noqa: PLC0415

    commands.validate(file, recordings, out)
