"""`mecazen hardware`: real robots, and an emulated one."""

from __future__ import annotations

import signal
import threading
import time
from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer
from mecazen.config import HardwareConfig
from mecazen.loading import given_file, load_table, scenario_path
from mecazen.robot import WHEELS, Robot
from mecazen_hardware.board import Voltage, WheelAngles
from mecazen_hardware.checklist import turn_each, wiring_problem
from mecazen_hardware.link import HardwareError, Link, usb_ports

app = typer.Typer(no_args_is_help=True, help="Real robots, and an emulated one.")

LINK = Path("/tmp/mecazen-board")  # noqa: S108  # our own name, whose owner is checked
"""The link to the emulated board's port, whose device name is not known in advance."""
LISTEN_S = 1.0

BoardOption = Annotated[
    str, typer.Option(metavar="BOARD", help="rosmaster_x3, or your own class as file.py:Class.")
]
PortOption = Annotated[
    str | None,
    typer.Option(metavar="PORT", help="The board's port.", show_default="the first USB adapter"),
]
RobotOption = Annotated[str, typer.Option(metavar="ROBOT", help="The robot file.")]


@app.command()
def probe(
    port: PortOption = None,
    board: BoardOption = "rosmaster_x3",
    robot: RobotOption = "rosmaster_x3",
) -> None:
    """Find a board, and show its version, battery and encoders; no motor turns.

    Example: mecazen hardware probe --port /dev/ttyUSB0
    """
    with closing(_open(port, board, robot)) as link:
        link.read()
        time.sleep(LISTEN_S)
        reports = [report for report, _ in link.read()]
        newest = {type(report): report for report in reports}
        typer.echo(f"{link.port.name}: {link.identity.name}")
        if isinstance(voltage := newest.get(Voltage), Voltage):
            typer.echo(f"battery: {voltage.volts:.1f} V")
        if isinstance(wheels := newest.get(WheelAngles), WheelAngles):
            turned = zip(WHEELS, wheels.angles, strict=True)
            typer.echo("turned: " + ", ".join(f"{name} {angle:.2f} rad" for name, angle in turned))
        for kind, count in Counter(type(report).__name__ for report in reports).items():
            typer.echo(f"{kind}: {count / LISTEN_S:.0f} Hz")
        typer.echo(f"damaged: {link.board.refused} of {link.board.frames} frames")


@app.command()
def check(
    port: PortOption = None,
    board: BoardOption = "rosmaster_x3",
    robot: RobotOption = "rosmaster_x3",
    yes: Annotated[
        bool, typer.Option("--yes", help="Ask nothing: the wheels are off the ground.")
    ] = False,
) -> None:
    """With the robot on blocks, turn one wheel at a time: check motor, direction, encoder sign.

    Example: mecazen hardware check --port /dev/ttyUSB0
    """
    if not yes:
        typer.confirm("Are all wheels off the ground, and is a hand on the switch?", abort=True)
    with closing(_open(port, board, robot)) as link:
        turned = turn_each(link, typer.echo)
    problems = 0
    for wheel, name in enumerate(WHEELS):
        problem = wiring_problem(wheel, turned[wheel])
        if not yes and not problem and not typer.confirm(f"Did {name} alone turn forward?"):
            problem = "its encoder agrees, but it did not: encoder and motor are of another wheel"
        problems += bool(problem)
        typer.echo(f"{name}: {problem or f'ok, turned {turned[wheel][wheel]:.1f} rad'}")
    if problems:
        raise HardwareError(f"{problems} of {len(WHEELS)} wheels are wrong; do not drive yet")


@app.command()
def emulate(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO",
            help="Scenario with start, ground and obstacles: a name or a TOML file.",
        ),
    ] = "teleop",
    link: Annotated[
        Path, typer.Option(metavar="PATH", help="Path of the port: a link to a pseudo-terminal.")
    ] = LINK,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Override one setting of the scenario. Repeatable."
        ),
    ] = None,
) -> None:
    """Emulate a ROSMASTER X3's board on a pseudo-terminal, with simulated physics, in real time.

    Example: mecazen hardware emulate
    """
    # the driver needs no physics
    from mecazen_hardware.emulator.firmware import Firmware  # noqa: PLC0415
    from mecazen_hardware.emulator.line import Emulator, SerialLine  # noqa: PLC0415
    from mecazen_hardware.emulator.world import EmulatedWorld, load  # noqa: PLC0415

    world = EmulatedWorld(load(scenario_path(scenario), settings or ()))
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: stopped.set())
    with closing(SerialLine(link)) as line:
        typer.echo(f"rosmaster_x3 at {link} ({line.name}), until Ctrl-C")
        emulator = Emulator(line, world, Firmware())
        emulator.run(stopped)
        typer.echo(f"{emulator.firmware.taken} frames taken, {emulator.firmware.lost} lost")


def _open(port: str | None, board: str, robot: str) -> Link:
    """Return the link to a board at a port, or at the first USB adapter."""
    ports = usb_ports() if port is None else [port]
    if not ports:
        raise HardwareError("no USB adapter here: plug the board in, or name its --port")
    loaded = load_table(given_file(robot, "robot"), Robot)
    return Link(HardwareConfig(board=board, port=ports[0]), loaded)
