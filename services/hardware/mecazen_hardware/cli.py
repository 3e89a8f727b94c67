"""`mecazen hardware`: real robots, and an emulated one."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import typer
from mecazen.config import HardwareConfig, Process
from mecazen.loading import given_file, load_table
from mecazen.robot import WHEELS, Robot
from mecazen.runtime import process
from mecazen_tools.cli.options import ScenarioArgument, Settings, load

from mecazen_hardware import checklist, fuzzing
from mecazen_hardware.board import Voltage, WheelAngles
from mecazen_hardware.boards import open_link
from mecazen_hardware.errors import HardwareError
from mecazen_hardware.link import Link
from mecazen_hardware.port import candidates

app = typer.Typer(no_args_is_help=True, help="Real robots, and an emulated one.")

LINK = Path("/tmp/mecazen-board")  # noqa: S108  # our own name, whose owner is checked
"""The link to the emulated board's port, whose device name is not known in advance."""
LISTEN_S = 1.0

BoardOption = Annotated[
    str, typer.Option(metavar="NAME", help="The board: rosmaster_x3, robomaster_ep, or your own.")
]
PortOption = Annotated[
    str | None,
    typer.Option(metavar="PORT", help="Its port.", show_default="the first USB adapter"),
]
RobotOption = Annotated[
    str | None,
    typer.Option(metavar="ROBOT", help="Its robot file.", show_default="the board's"),
]


@app.command()
def probe(
    port: PortOption = None, board: BoardOption = "rosmaster_x3", robot: RobotOption = None
) -> None:
    """Find a board, and show its version, battery and encoders; no motor turns.

    Example: mecazen hardware probe --port /dev/ttyUSB0
    """
    link, _ = _open(port, board, robot)
    with closing(link):
        link.read()
        time.sleep(LISTEN_S)
        reports = link.read()
        typer.echo(f"{link.port.name}: {link.identity.name}")
        if (voltage := link.newest(Voltage)) is not None:
            typer.echo(f"battery: {voltage.volts:.1f} V")
        if (angles := link.newest(WheelAngles)) is not None:
            turned = zip(WHEELS, angles.turned, strict=True)
            typer.echo("turned: " + ", ".join(f"{name} {angle:.2f} rad" for name, angle in turned))
        for kind, rate_hz in checklist.rates(reports).items():
            typer.echo(f"{kind}: {rate_hz:.1f} Hz")
        typer.echo(f"damaged: {link.board.refused} of {link.board.frames} frames")


@app.command()
def check(
    port: PortOption = None,
    board: BoardOption = "rosmaster_x3",
    robot: RobotOption = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="Ask nothing: the wheels are off the ground.")
    ] = False,
) -> None:
    """Turn each wheel in turn, with the robot on blocks: motor, direction, sign of its encoder.

    Example: mecazen hardware check --port /dev/ttyUSB0
    """
    if not yes:
        typer.confirm("Are all wheels off the ground, and is a hand on the switch?", abort=True)
    link, known = _open(port, board, robot)
    with closing(link):
        found = checklist.turn_each(link, known.wheels.max_speed_rad_s, typer.echo)
    problems = 0
    for one in found:
        problem = one.problem
        if not yes and not problem and not typer.confirm(f"Did {one.wheel} alone turn forward?"):
            problem = "its encoder agrees, but it did not: encoder and motor are of another wheel"
        problems += bool(problem)
        turned = one.turned[WHEELS.index(one.wheel)]
        typer.echo(f"{one.wheel}: {problem or f'ok, turned {turned:.1f} rad'}")
    if problems:
        raise HardwareError(f"{problems} of {len(found)} wheels are wrong; do not drive yet")


@app.command()
def run(
    scenario: ScenarioArgument,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print frames, and open no port.")
    ] = False,
    settings: Settings = None,
) -> None:
    """Run the driver alone in this terminal, as `mecazen run hardware` does.

    Example: mecazen hardware run teleop --dry-run --set 'services=["hardware","controller"]'
    """
    overrides = [*(settings or ()), *(["hardware.dry_run=true"] if dry_run else [])]
    process.run(Process(("hardware",)), load(scenario, overrides))


@app.command()
def fuzz(
    frames: Annotated[int, typer.Option(min=1, help="Number of frames.")] = 1_000_000,
    seed: Annotated[int, typer.Option(help="Seed of the damage.")] = 1,
) -> None:
    """Feed the receiver of the X3 with damaged frames, and count what it makes of them.

    Example: mecazen hardware fuzz --frames 1000000
    """
    found = fuzzing.fuzz(frames, seed)
    for name, value in msgspec.to_builtins(found).items():
        typer.echo(f"{name.replace('_', ' ')}: {value}")


@app.command()
def latency(
    duration_s: Annotated[float, typer.Option("--duration", min=1.0, help="Seconds.")] = 60.0,
    tick_s: Annotated[
        float, typer.Option("--tick", min=0.001, help="Control period, in seconds.")
    ] = 0.01,
) -> None:
    """Measure from a command to its frame on the line, and from a report to joint_states.

    Example: mecazen hardware latency --duration 60
    """
    from mecazen_hardware.emulator.latency import measure  # noqa: PLC0415  # as in `emulate`

    for name, found in measure(given_file("teleop", "scenario"), duration_s, tick_s).items():
        typer.echo(
            f"{name}: p50 {found.p50_ms} ms, p99 {found.p99_ms} ms, largest {found.max_ms} ms, "
            f"of {found.samples}"
        )


@app.command()
def emulate(
    board: Annotated[Literal["rosmaster_x3"], typer.Argument(help="The board.")],
    scenario: ScenarioArgument = "teleop",
    link: Annotated[
        Path, typer.Option(metavar="PATH", help="Name of its port: a link to a pseudo-terminal.")
    ] = LINK,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=CHANCE|NAME@SECONDS",
            help="drop=, corrupt=, cut=, merge= CHANCE of a frame; delay=SECONDS; silence@, "
            "unplug@, brownout@, jump@ SECONDS. Repeatable.",
            show_default=False,
        ),
    ] = None,
    duration_s: Annotated[
        float | None,
        typer.Option(
            "--duration",
            help="Seconds to emulate, from the first frame that drives.",
            show_default="until Ctrl-C",
        ),
    ] = None,
    settings: Settings = None,
) -> None:
    """Be a board on a pseudo-terminal, in front of the physics of a scenario, in real time.

    Persons and sensors of the scenario are published on its bus, once there is one, as drivers on
    the robot would.

    Examples: mecazen hardware emulate rosmaster_x3 back ·
    mecazen hardware emulate rosmaster_x3 teleop --fault corrupt=0.01 --fault unplug@10
    """
    from mecazen_hardware.emulator import cli  # noqa: PLC0415  # the driver needs no physics

    del board
    cli.emulate(given_file(scenario, "scenario"), settings or (), link, fault or (), duration_s)


def _open(port: str | None, board: str, robot: str | None) -> tuple[Link, Robot]:
    """Return the link to a board at a port, or at the first USB adapter, and its robot file.

    Raises:
        HardwareError: There is no port, or the board does not answer.
    """
    if port is None:
        found = candidates()
        if not found:
            raise HardwareError("no USB adapter here: plug the board in, or name its --port")
        port = found[0].device
    known = load_table(given_file(robot or board, "robot"), Robot)
    link = open_link(HardwareConfig(board=board, port=port), known)
    assert isinstance(link, Link)  # not a dry run
    return link, known
