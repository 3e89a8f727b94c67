"""The commands of `mecazen`."""

from __future__ import annotations

import errno
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module, metadata
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from mecazen.config import Scenario
from mecazen.errors import ConfigError, MecazenError
from mecazen.explain import one_line
from mecazen.extras import is_installed
from mecazen.files import to_value
from mecazen.loading import scenario_path, to_toml
from mecazen.runtime import __main__ as runtime
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from mecazen_tools import INTERRUPTED, certificates, drawing, files
from mecazen_tools.cli import param, sim, status, talk, teleop, up
from mecazen_tools.cli.options import ScenarioArgument, Settings, console, load
from mecazen_tools.simulate import (
    InterruptedRun,
    Result,
    collect,
    simulate,
    simulate_distributed,
)
from mecazen_tools.trajectory import Scores, Trajectory

RECORDER = "recorder"
EXTRAS = {
    "hardware": {"hardware": "mecazen_hardware.cli:app"},
    "recorder": {
        "record": "mecazen_recorder.cli:record",
        "replay": "mecazen_recorder.cli:replay",
        "info": "mecazen_recorder.cli:info",
        "plot": "mecazen_recorder.cli:plot",
    },
    "viewer": {"view": "mecazen_viewer.cli:view"},
    "studies": {
        "experiment": "mecazen_experiments.cli:app",
        "identify": "mecazen_experiments.identify.cli:identify",
        "gait": "mecazen_experiments.gait.cli:gait",
    },
    "bench": {"bench": "mecazen_bench.cli:app"},
}
"""Commands of extras: a function or a group of commands, by extra and by name."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors of a full disk."""

TrajectoryFile = Annotated[
    Path | None,
    typer.Option("--trajectory", metavar="FILE.csv", help="Write every tick.", show_default=False),
]
PictureFile = Annotated[
    Path | None,
    typer.Option(
        "--plot", metavar="FILE", help="Draw the run: PNG, SVG or PDF.", show_default=False
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="mecazen: a mecanum robot follows a person. Services over Zenoh, real rollers, one result."
    "\n\nStart with [bold]mecazen up back[/], or [bold]mecazen simulate back[/].",
)
certificates_app = typer.Typer(
    no_args_is_help=True, help="Certificates, for TLS and access control."
)
app.add_typer(sim.app, name="sim")
app.add_typer(param.app, name="param")
app.add_typer(certificates_app, name="keys")
app.command()(talk.graph)
app.command()(talk.topics)
app.command()(status.status)
app.command()(talk.echo)
app.command()(talk.pub)
app.command()(teleop.teleop)
for extra in filter(is_installed, EXTRAS):
    for name, place in EXTRAS[extra].items():
        module, _, attribute = place.partition(":")
        command = getattr(import_module(module), attribute)
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name)
        else:
            app.command(name)(command)


app.command()(up.up)


@app.command()
def run(
    service: Annotated[
        str,
        typer.Argument(
            help="A service of the scenario (physics, controller, …), several joined by +, "
            "or router.",
            show_default=False,
        ),
    ],
    scenario: ScenarioArgument,
    robot: Annotated[
        str, typer.Option(metavar="NAME", help="The robot, of several.", show_default=False)
    ] = "",
    settings: Settings = None,
) -> None:
    """Run one process in this terminal, until Ctrl-C.

    Examples: mecazen run router back · mecazen run physics back ·
    mecazen run controller+follower back
    """
    runtime.run(service, load(scenario, settings), robot)


def _tell_version(asked: bool) -> None:
    if asked:
        typer.echo(f"mecazen {metadata.version('mecazen')}")
        raise typer.Exit


@app.callback()
def _global(
    version: Annotated[
        bool,
        typer.Option("--version", help="Print the version.", callback=_tell_version, is_eager=True),
    ] = False,
) -> None:
    """Take the options of `mecazen` itself; its help is the application's."""


@app.command(name="simulate")
def simulate_command(
    scenario: ScenarioArgument,
    seed: Annotated[
        int | None,
        typer.Option(
            min=0, max=2**32 - 1, help="Seed of the noise.", show_default="the scenario's"
        ),
    ] = None,
    duration_s: Annotated[
        float | None,
        typer.Option("--duration", min=0, help="Simulated seconds.", show_default="the scenario's"),
    ] = None,
    distributed: Annotated[
        bool, typer.Option("--distributed", help="As processes over Zenoh; the result is the same.")
    ] = False,
    trajectory: TrajectoryFile = None,
    plot: PictureFile = None,
    record: Annotated[
        str | None,
        typer.Option(
            metavar="FILE.mcap",
            help="Record everything: the same as services with recorder, and recorder.file.",
            show_default=False,
        ),
    ] = None,
    as_json: AsJson = False,
    settings: Settings = None,
) -> None:
    """Run a whole scenario as fast as it can, in lockstep, and score it.

    The same scenario and seed give the same trajectory to the last bit, in this process or
    with --distributed; its hash says so.

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
    if distributed:
        work = partial(simulate_distributed, path, tuple(overrides), path.stem)
    else:
        work = partial(simulate, loaded, path.stem)
    _run(f"simulating {path.stem}", work, loaded, trajectory, plot, as_json=as_json)


@app.command(name="collect")
def collect_command(
    scenario: ScenarioArgument,
    trajectory: TrajectoryFile = None,
    plot: PictureFile = None,
    as_json: AsJson = False,
    settings: Settings = None,
) -> None:
    """Score a lockstep run of services that run elsewhere, as in containers.

    The services and this need the same scenario and settings, among them sim.mode=lockstep and
    a list of services with "collector" in it; they begin when it has joined. The result is that
    of `mecazen simulate`.

    Example: mecazen collect back --set sim.mode=lockstep
    --set 'services=["physics","controller","target","follower","collector"]'
    """
    _refuse_unwritable(trajectory, plot)
    name = scenario_path(scenario).stem
    loaded = load(scenario, settings)
    work = partial(collect, loaded, name)
    _run(f"collecting {name}", work, loaded, trajectory, plot, as_json=as_json)


def _run(
    description: str,
    work: Callable[[Callable[[int], None]], tuple[Result, Trajectory]],
    scenario: Scenario,
    trajectory: Path | None,
    plot: Path | None,
    *,
    as_json: bool,
) -> None:
    """Make a run with a progress bar, and report it, also what there is of it after Ctrl-C."""
    is_whole = True
    with _progress(description, scenario.sim.ticks) as progress:
        try:
            result, run = work(progress)
        except InterruptedRun as interrupt:
            result, run = interrupt.args
            is_whole = False
    _report(result, run, trajectory, as_json=as_json)
    if plot is not None:
        _draw(run, scenario, result, plot, quiet=as_json)
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
def _progress(description: str, ticks: int) -> Iterator[Callable[[int], None]]:
    """Show a progress bar; yield a function that sets the number of finished ticks."""
    terminal = Console(stderr=True)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
        console=terminal,
        transient=True,
        disable=not terminal.is_terminal,  # else it ends with an empty line
    ) as bar:
        task = bar.add_task(description, total=ticks)
        yield lambda done: bar.update(task, completed=done)


def _report(result: Result, run: Trajectory, file: Path | None, *, as_json: bool) -> None:
    """Print the scores, then write the file, so that a full disk does not cost the scores."""
    if as_json:
        typer.echo(msgspec.json.format(msgspec.json.encode(result)).decode())
    else:
        table = Table("simulated", "real-time factor", "distance error", "heading error")
        table.add_row(f"{result.duration_s:g} s", f"{result.rtf:.1f}", *_measures(result))
        for name, scores in result.robots.items():
            table.add_row(name, "", *_measures(scores))
        console(80).print(table)
        typer.echo(
            f"contacts: {result.contacts_persons} with followed persons, "
            f"{result.contacts_obstacles} with obstacles"
        )
        typer.echo(f"trajectory: sha256 {result.trajectory_sha256}")
    if file is not None:
        files.write(file, run.csv(), "--trajectory")
        if not as_json:
            typer.echo(f"every tick: {file}")


def _draw(run: Trajectory, scenario: Scenario, result: Result, file: Path, *, quiet: bool) -> None:
    from mecazen_tools import run_figure  # noqa: PLC0415  # Matplotlib is an extra, and slow

    title = f"{result.scenario}, seed {result.seed}"
    figure = run_figure.draw(run_figure.courses(run, scenario), scenario, title)
    drawing.save(figure, file, "--plot")
    if not quiet:
        typer.echo(f"picture: {file}")


def _measures(of: Result | Scores) -> tuple[str, str]:
    """Return the measures of following as readable text."""
    return (
        "-" if of.d_err_m is None else f"{of.d_err_m:.4f} m",
        "-" if of.theta_err_deg is None else f"{of.theta_err_deg:.2f}°",
    )


@app.command()
def config(scenario: ScenarioArgument, settings: Settings = None) -> None:
    """Print the whole effective configuration of a scenario, as TOML that loads again."""
    typer.echo(to_toml(load(scenario, settings)), nl=False)


@certificates_app.callback()
def _group() -> None:
    """Keep `create` a command of its own, although it is the only one."""


@certificates_app.command()
def create(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A new folder; keep it to yourself.")
    ] = Path("keys"),
    host: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME_OR_IP",
            help="A host that services listen on, besides loopback. Repeatable.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Create a certificate authority, and a certificate and a key for each service.

    The operator's are for the tools: `--tls DIR`.

    Examples: mecazen keys create · mecazen keys create keys --host robot.local --host 192.168.1.7
    """
    certificates.create(folder, host or ())
    typer.echo(f"{folder}: the authority and {len(certificates.NAMES)} certificates with keys")


def main(commands: typer.Typer = app) -> None:
    """Run a command line; print an expected error in one line."""
    arguments = sys.argv[1:]
    if arguments[:1] == ["help"]:
        arguments = [*arguments[1:], "--help"]
    try:
        for argument in arguments:
            if argument != argument.encode(errors="replace").decode():
                raise ConfigError(f"{argument!r}: not UTF-8, as all arguments must be")
        sys.exit(commands(arguments, standalone_mode=False))
    except typer.TyperException as error:
        sys.stderr.write(_usage_error(error))
        sys.exit(error.exit_code)
    except MecazenError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(error.exit_code)
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        sys.stderr.write(f"error: the output is incomplete: {error.strerror}\n")
        sys.exit(1)


def _usage_error(error: typer.TyperException) -> str:
    """Return the error of a command line in one line; empty if help was shown."""
    told = one_line(error.format_message().strip()).rstrip(".")
    if not told:
        return ""
    context = getattr(error, "ctx", None)  # set for an error in the usage of a command
    mark = "" if told.endswith("?") else ";"
    hint = f"{mark} `{context.command_path} --help` tells what is allowed" if context else ""
    if context and context.command_path.endswith(" run") and told.startswith("Missing"):
        hint = "; `run` starts one process, as in `mecazen run physics back`; `mecazen up back` "
        hint += "and `mecazen simulate back` start all of them"
    for extra, name in ((extra, name) for extra, names in EXTRAS.items() for name in names):
        if told.startswith(f"No such command '{name}'"):
            told = f"No such command '{name}'"
            hint = f"; it needs pip install 'mecazen[{extra}]'"
    return f"error: {told}{hint}\n"
