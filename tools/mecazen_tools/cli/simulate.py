"""`mecazen simulate`, `mecazen collect` and `mecazen compare`: whole runs in lockstep, scored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from mecazen.config import Scenario
from mecazen.errors import MecazenError
from mecazen.files import to_value
from mecazen.loading import load_scenario, scenario_path
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table
from rich.text import Text
from typer import Argument, Option

from mecazen_tools import INTERRUPTED, drawing, files
from mecazen_tools import simulate as runs
from mecazen_tools.cli.options import (
    Duration,
    ScenarioArgument,
    Settings,
    console,
    load,
    output,
    warn,
)
from mecazen_tools.simulate import InterruptedRun, Result, Summary
from mecazen_tools.trajectory import Scores, Trajectory, sentence

if TYPE_CHECKING:
    from mecazen_tools.comparison import Comparison
    from mecazen_tools.statistics import Interval

RECORDER = "recorder"

TrajectoryFile = Annotated[
    Path | None, Option("--trajectory", metavar="FILE.csv", help="Write a row per tick.")
]
PictureFile = Annotated[
    Path | None,
    Option("--plot", metavar="FILE", help="Draw the run: PNG, SVG or PDF."),
]
AsJson = Annotated[bool, Option("--json", help="Print the result as JSON.")]


def simulate(
    scenario: ScenarioArgument,
    seed: Annotated[
        int | None,
        Option(min=0, max=2**32 - 1, help="Seed of the noise.", show_default="the scenario's"),
    ] = None,
    duration_s: Duration = None,
    distributed: Annotated[
        bool, Option("--distributed", help="Run processes over Zenoh, with the same result.")
    ] = False,
    trajectory: TrajectoryFile = None,
    plot: PictureFile = None,
    record: Annotated[
        str | None,
        Option(
            metavar="FILE.mcap",
            help="Record everything: add recorder to services, and set recorder.file.",
        ),
    ] = None,
    as_json: AsJson = False,
    settings: Settings = None,
) -> None:
    """Run a whole scenario in lockstep, as fast as possible, and score it.

    The same scenario and seed give a bit-identical trajectory, in this process or with
    --distributed, as the hash shows.

    Examples: mecazen simulate back --seed 7 --json · mecazen simulate side --trajectory run.csv ·
    mecazen simulate back --plot run.png
    """
    overrides = list(settings or ())
    if seed is not None:
        overrides.append(f"seed={seed}")
    if duration_s is not None:
        overrides.append(f"sim.duration_s={duration_s}")
    path = scenario_path(scenario)
    loaded = load(scenario, overrides)
    if record is not None:
        overrides.append(f"services={to_value([*loaded.services, RECORDER])}")
        overrides.append(f"{RECORDER}.file={to_value(record)}")
        loaded = load(scenario, overrides)
    _refuse_unwritable(trajectory, plot)
    warn(loaded)
    if distributed:
        work = partial(runs.simulate_distributed, path, tuple(overrides), path.stem)
    else:
        work = partial(runs.simulate, loaded, path.stem)
    _run(f"simulating {path.stem}", work, loaded, trajectory, plot, as_json=as_json)


def collect(
    scenario: ScenarioArgument,
    trajectory: TrajectoryFile = None,
    plot: PictureFile = None,
    as_json: AsJson = False,
    settings: Settings = None,
) -> None:
    """Score a lockstep run of services that run elsewhere, such as in containers.

    The services and this command need the same scenario and settings, with sim.mode=lockstep and
    "collector" in services. The run begins when this command has joined. The result is that of
    `mecazen simulate`.

    Example: mecazen collect back --set sim.mode=lockstep
    --set 'services=["physics","controller","target","follower","collector"]'
    """
    _refuse_unwritable(trajectory, plot)
    name = scenario_path(scenario).stem
    loaded = load(scenario, settings)
    work = partial(runs.collect, loaded, name)
    _run(f"collecting {name}", work, loaded, trajectory, plot, as_json=as_json)


def compare(
    scenario: ScenarioArgument,
    followers: Annotated[
        list[str],
        Argument(
            metavar="FOLLOWER...",
            help="Two or more: default, a program such as my_follower.py:MyFollower, a trained "
            "policy:weights.npz, or settings such as follower.estimator=none. The last one is the "
            "reference.",
        ),
    ],
    seeds: Annotated[int, Option(min=1, max=10_000, help="Number of seeds; the first is 1.")] = 10,
    duration_s: Duration = None,
    output: Annotated[
        Path | None, output("Draw paths, errors and measures: PNG, SVG or PDF.")
    ] = None,
    as_json: AsJson = False,
    settings: Settings = None,
) -> None:
    """Compare followers by their differences per seed, with the same scenario and seeds.

    Examples: mecazen compare back my_follower.py:MyFollower default --seeds 30 -o comparison.pdf ·
    mecazen compare back follower.standoff_m=1.5 default
    """
    from mecazen_tools import comparison  # noqa: PLC0415  # imports SciPy

    if output is not None:
        drawing.refuse_undrawable(output, "-o")
    path = scenario_path(scenario)
    overrides = list(settings or ())
    if duration_s is not None:
        overrides.append(f"sim.duration_s={duration_s}")
    candidates = comparison.candidates(path, followers, overrides)
    numbers = range(1, seeds + 1)
    with progress(f"comparing in {path.stem}", len(candidates) * seeds) as done:
        runs = comparison.run_all(path, candidates, numbers, done)
    result = comparison.compare(path.stem, runs)
    if as_json:
        typer.echo(msgspec.json.format(msgspec.json.encode(result)).decode())
    else:
        _print_comparison(result, comparison.MEASURES)
    if output is not None:
        from mecazen_tools.run_figure import draw_comparison  # noqa: PLC0415  # an extra

        loaded = load_scenario(path, candidates[result.reference])
        figure = draw_comparison(result, runs, loaded, comparison.MEASURES)
        drawing.save(figure, output, "-o")
        if not as_json:
            typer.echo(f"picture: {output}")


def _print_comparison(result: Comparison, digits: Mapping[str, int]) -> None:
    from mecazen_tools.statistics import LEAST_UNITS, show  # noqa: PLC0415  # imports SciPy

    def verdict(difference: Interval) -> str:
        if difference.n < LEAST_UNITS:
            return ""
        if difference.low <= 0.0 <= difference.high:
            return "\nno difference shown"
        return "\nworse" if difference.low > 0.0 else "\nbetter"

    table = Table("follower", "n", *map(escape, digits))
    count = len(result.seeds)
    for name, means in result.means.items():
        cells = [show(means[key], digits[key]) if key in means else "-" for key in digits]
        table.add_row(*map(Text, (name, str(count), *cells)))
    table.add_section()
    for name, differences in result.differences.items():
        cells = [
            show(differences[key], digits[key], "+") + verdict(differences[key])
            if key in differences
            else "-"
            for key in digits
        ]
        table.add_row(*map(Text, (f"{name} − {result.reference}", str(count), *cells)))
    console(120).print(table)
    few = f"; no verdict below {LEAST_UNITS} seeds" if count < LEAST_UNITS else ""
    typer.echo(f"means with 95 % t intervals over {count} seeds, differences seed by seed{few}")


def _run(
    description: str,
    work: Callable[[Callable[[int], None]], tuple[Result, Trajectory]],
    scenario: Scenario,
    trajectory: Path | None,
    plot: Path | None,
    *,
    as_json: bool,
) -> None:
    """Make a run with a progress bar, and report it, also what there is of it after Ctrl-C.

    The scores come before the files, so that a full disk does not cost them.
    """
    note: Callable[[str], None] = (lambda _: None) if as_json else typer.echo
    is_whole = True
    with progress(description, scenario.sim.ticks) as done:
        try:
            result, run = work(done)
        except InterruptedRun as interrupt:
            result, run = interrupt.args
            is_whole = False
    if as_json:
        typer.echo(msgspec.json.format(msgspec.json.encode(result)).decode())
    else:
        print_scores(result, "real-time factor", f"{result.rtf:.1f}")
        typer.echo(f"trajectory: sha256 {result.trajectory_sha256}")
    if trajectory is not None:
        files.write(trajectory, run.csv(), "--trajectory")
        note(f"every tick: {trajectory}")
    if plot is not None:
        from mecazen_tools import run_figure  # noqa: PLC0415  # Matplotlib is an extra, and slow

        title = f"{result.scenario}, seed {result.seed}"
        figure = run_figure.draw(run_figure.courses(run), scenario, title)
        drawing.save(figure, plot, "--plot")
        note(f"picture: {plot}")
    if not is_whole:
        whole_s = scenario.sim.duration_s
        typer.echo(f"interrupted after {result.duration_s:g} of {whole_s:g} s", err=True)
        raise typer.Exit(INTERRUPTED)


def _refuse_unwritable(trajectory: Path | None, plot: Path | None) -> None:
    """Check before the run that its files can be written."""
    if trajectory is not None and not trajectory.absolute().parent.is_dir():
        raise MecazenError(f"--trajectory {trajectory}: no such folder")
    if trajectory is not None and trajectory.is_file():
        raise MecazenError(f"--trajectory {trajectory}: exists already, and is not overwritten")
    if plot is not None:
        drawing.refuse_undrawable(plot, "--plot")


@contextmanager
def progress(description: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show a progress bar; yield a function that sets the number of finished ticks or runs."""
    terminal = Console(stderr=True)
    # outside a terminal it would end with an empty line
    with Progress(console=terminal, transient=True, disable=not terminal.is_terminal) as bar:
        task = bar.add_task(description, total=total)
        yield lambda done: bar.update(task, completed=done)


def print_scores(result: Summary, column: str, cell: str) -> None:
    """Print what a run shows, with a column of its own after the duration."""
    table = Table("simulated", column, "distance error", "heading error")
    table.add_row(f"{result.duration_s:g} s", Text(cell), *measures(result))
    for name, scores in result.robots.items():
        table.add_row(name, "", *measures(scores))
    console(80).print(table)
    lost = {name: scores.lost for name, scores in result.robots.items()} or {"": result.lost}
    for name, shares in lost.items():
        if line := sentence(shares):
            typer.echo(f"{name}: {line}" if name else line)
    typer.echo(
        f"contacts: {result.contacts_persons} with followed persons, "
        f"{result.contacts_obstacles} with obstacles"
    )


def measures(scores: Summary | Scores) -> tuple[str, str]:
    """Return the errors of following as text; a run without a person has none."""
    return (
        "-" if scores.d_err_m is None else f"{scores.d_err_m:.4f} m",
        "-" if scores.theta_err_deg is None else f"{scores.theta_err_deg:.2f}°",
    )
