"""`mecazen record`, `mecazen replay`, `mecazen info`, `mecazen score` and `mecazen plot`.

Libraries are imported when a command runs, so that `mecazen --help` stays fast.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

import math
import sys
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from mecazen.errors import BusError, ConfigError, MecazenError, UntrustedError
from mecazen.graph import WORLDS
from mecazen.keys import TOPICS
from mecazen.robots import join_key
from mecazen.text import printable
from mecazen.wire import NS_PER_S
from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from mecazen_tools import drawing
from mecazen_tools.cli.options import RecordedScenario, RecordingFile, Topics, output, tool_bus
from mecazen_tools.cli.simulate import print_scores
from mecazen_tools.simulate import summary

if TYPE_CHECKING:
    from mecazen_recorder.reader import Recording

    from mecazen_tools.recorded import RecordedTrajectory

RecordingFiles = Annotated[list[Path], typer.Argument(metavar="FILE...", help="Recordings.")]
RunNumber = Annotated[
    int | None,
    typer.Option(
        "--run", metavar="N", help="Number of the run; see mecazen info.", show_default="the last"
    ),
]


def record(
    context: typer.Context,
    keys: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[KEYS]...",
            help="Keys, or expressions such as 'target/**'.",
            show_default="all",
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE.mcap", help="A new file.")
    ] = Path("run.mcap"),
) -> None:
    """Record published samples in MCAP, until Ctrl-C.

    Rerun, Foxglove, PlotJuggler and ros2 bag read the file. Times are simulated times. After a
    crash all but the last half second can be read.

    Examples: mecazen record -o run.mcap · mecazen record odom 'target/**'
    """
    from mecazen.config import RecorderConfig
    from mecazen.schema import OutputFile
    from mecazen_recorder.service import record_until_stopped

    config = RecorderConfig(file=OutputFile(output), keys=tuple(keys or ["**"]))
    with tool_bus(context) as bus:
        count = record_until_stopped(bus, config)
        lost = bus.refused.total()
    if not count:
        output.unlink()
        raise MecazenError(f"{output}: not written, since no sample came" + _also_lost(lost))
    typer.echo(f"{output}: {count} samples{_also_lost(lost)}")


def _also_lost(count: int) -> str:
    return f", {count} refused or dropped" if count else ""


def replay(
    context: typer.Context,
    file: RecordingFile,
    speed: Annotated[
        float, typer.Option(min=0.01, max=1000, help="Simulated seconds per wall second.")
    ] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Begin again at the end.")] = False,
    keys: Annotated[
        list[str] | None,
        typer.Option(
            "--keys",
            metavar="KEY",
            help="A key, or an expression such as 'target/**'. Repeatable.",
            show_default="all",
        ),
    ] = None,
    begin_s: Annotated[
        float, typer.Option("--from", metavar="S", min=0, help="First simulated second.")
    ] = 0.0,
    end_s: Annotated[
        float | None,
        typer.Option(
            "--to", metavar="S", min=0, help="Last simulated second.", show_default="the end"
        ),
    ] = None,
    through: Annotated[
        str | None,
        typer.Option(
            metavar="SERVICE",
            help="Publish nothing: feed a service (or file.py:Class) with its recorded inputs, and "
            "compare its outputs with the recording. Ends at the first difference, with exit code "
            "1.",
        ),
    ] = None,
    robot: Annotated[
        str,
        typer.Option(metavar="NAME", help="With --through: the robot, if there are several."),
    ] = "",
    trust: Annotated[
        bool,
        typer.Option(
            "--trust",
            help="With --through: run the programs and open the files that the recording names. "
            "Programs are code.",
        ),
    ] = False,
    topics: Topics = "",
    scenario: RecordedScenario = None,
) -> None:
    """Publish a recording with its original stamps, or re-compute a service from it.

    Examples: mecazen replay run.mcap --keys odom --keys 'target/*' --loop ·
    mecazen replay run.mcap --through follower ·
    mecazen replay convoy.mcap --through follower --robot two
    """
    from mecazen.urdf import serve_description
    from mecazen_recorder.foreign import open_recording
    from mecazen_recorder.service import publish

    recording = open_recording(file, topics, scenario, trusted=trust)
    if through is not None:
        if loop or keys or begin_s or end_s is not None:
            raise ConfigError(
                "--through takes the whole recording: no --loop, --keys, --from, --to"
            )
        _recompute(recording, through, robot)
        return
    if robot:
        raise ConfigError(f"--robot goes with --through; --keys '{robot}/**' takes all of {robot}")
    begin_ns = round(begin_s * NS_PER_S)
    end_ns = math.inf if end_s is None else round(end_s * NS_PER_S)
    try:
        descriptions = recording.descriptions()
    except MecazenError as error:
        typer.echo(f"warning: {error}; replayed without robot_description", err=True)
        descriptions = {}
    with tool_bus(context) as bus:
        commands = [topic.key for topic in TOPICS if topic.open]
        driving = {join_key(key, name) for name in ("", *descriptions) for key in commands}
        alive = bus.alive()
        if not driving.issuperset(keys or ["**"]) and alive.intersection(WORLDS):
            raise BusError(
                "a simulation runs there, and what it publishes would mix with the recording: end "
                f"it first, or replay commands alone: --keys {' or '.join(commands)}"
            )
        for name, description in descriptions.items():
            serve_description(bus, name, description)
        for turn in count() if loop else range(1):
            published = publish(
                recording,
                bus,
                keys or ["**"],
                speed=speed,
                begin_ns=begin_ns,
                end_ns=end_ns,
                turn=turn,
            )
            if turn == 0:
                report_damage(recording, any_samples=published > 0)
                typer.echo(f"{published} samples published")


def _recompute(recording: Recording, program: str, robot: str) -> None:
    from mecazen_recorder.recompute import recompute

    try:
        compared = recompute(recording, program, robot)
    except UntrustedError as error:
        if not (sys.stdin.isatty() and typer.confirm(f"{error}. Allow it now?")):
            raise UntrustedError(f"{error}: --trust allows it") from None
        recording.trusted = True
        compared = recompute(recording, program, robot)
    report_damage(recording)
    if compared.difference is not None:
        raise MecazenError(f"{recording.path}: {compared.difference}")
    counts = sorted(compared.counts.items())
    samples = ", ".join(f"{count} of {key}" for key, count in counts)
    typer.echo(f"{program}: identical: {samples}")


def info(
    file: RecordingFile,
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON.")] = False,
    topics: Topics = "",
) -> None:
    """Show the contents of a recording: runs, keys, counts, rates and gaps."""
    from mecazen_recorder.foreign import open_recording

    from mecazen_tools.recorded import inspect

    recording = open_recording(file, topics)
    contents = inspect(recording)
    report_damage(recording, any_samples=contents.count > 0)
    if as_json:
        typer.echo(msgspec.json.format(msgspec.json.encode(contents)).decode())
        return
    table = Table(Column("key", no_wrap=True), "message", "samples", "Hz", "gaps", "longest gap")
    for key in contents.keys:
        rate = "-" if key.rate_hz is None else f"{key.rate_hz:g}"
        longest = "-" if key.longest_gap_s is None else f"{key.longest_gap_s:g} s"
        message = key.type.rpartition("/msg/")[2]  # a terminal is narrow, and keys may be long
        cells = key.key, message, str(key.count), rate, str(key.gaps), longest
        table.add_row(*(Text(printable(cell)) for cell in cells))  # any client can choose a key
    Console().print(table)
    for run in contents.runs:
        known = "" if run.has_scenario else ", without its configuration"
        seed = "" if run.seed is None else f", seed {run.seed}"
        robots = f", robots {', '.join(run.robots)}" if run.robots else ""
        span = f"{run.begin_s:g} to {run.end_s:g} s"
        typer.echo(f"run {run.run}{seed}{robots}: {span}{known}")
        for line in (*run.lost, *(f"changed at {change}" for change in run.changes)):
            typer.echo(printable(f"  {line}"))


def score(
    files: RecordingFiles,
    run: RunNumber = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print it as JSON.")] = False,
    topics: Topics = "",
    scenario: RecordedScenario = None,
) -> None:
    """Score recorded runs as mecazen simulate does, whichever program drove.

    The recording needs the true poses, ground_truth/odom and target/odom. The standoff is that of
    the recorded configuration.

    Examples: mecazen score run.mcap · mecazen score first.mcap second.mcap --json
    """
    runs = _read(files, run, topics, scenario)
    scores = {name: summary(trajectory) for name, trajectory in runs.items()}
    if as_json:
        typer.echo(msgspec.json.format(msgspec.json.encode(scores)).decode())
        return
    for name, shown in scores.items():
        print_scores(shown, "recording", name)


def plot(
    files: RecordingFiles,
    output: Annotated[
        Path | None, output("The picture: PNG, SVG or PDF.", "FILE.png beside the first recording")
    ] = None,
    run: RunNumber = None,
    topics: Topics = "",
    scenario: RecordedScenario = None,
) -> None:
    """Draw recorded runs from above, and their errors and velocities over time.

    Several recordings are drawn over each other, with the obstacles of the first one.

    Examples: mecazen plot run.mcap · mecazen plot first.mcap second.mcap -o both.pdf
    """
    target = files[0].with_suffix(".png") if output is None else output
    drawing.refuse_undrawable(target, "-o")
    runs = _read(files, run, topics, scenario)
    from mecazen_tools.run_figure import courses, draw  # after the check of Matplotlib

    first, *others = runs.values()
    title = "" if others else f"{files[0].name}, run {first.run}, seed {first.scenario.seed}"
    drawn = [
        course
        for name, trajectory in runs.items()
        for course in courses(trajectory, name if others else "")
    ]
    drawing.save(draw(drawn, first.scenario, title), target, "-o")
    typer.echo(f"picture: {target}")


def _read(
    files: list[Path], run: int | None, topics: str, scenario: str | None
) -> dict[str, RecordedTrajectory]:
    """Return the runs of recordings by the names of the files, which differ."""
    from mecazen_recorder.foreign import open_recording

    from mecazen_tools.recorded import trajectory_of

    recordings = [open_recording(file, topics, scenario) for file in files]
    trajectories = [trajectory_of(recording, run) for recording in recordings]
    for recording in recordings:
        report_damage(recording)
    stems = [file.stem for file in files]
    names = stems if len({*stems}) == len(stems) else [str(file) for file in files]
    return dict(zip(names, trajectories, strict=True))


def report_damage(recording: Recording, *, any_samples: bool = True) -> None:
    """Report that the end is missing; a recording without a sample is an error, damaged or not."""
    if not any_samples:
        cut = ", and its end is missing" if recording.is_cut_off else ""
        raise MecazenError(f"{recording.path}: no sample in it{cut}")
    if recording.is_cut_off:
        problem = "the end of the file is missing; what is there was read"
        typer.echo(f"{recording.path}: {problem}", err=True)
