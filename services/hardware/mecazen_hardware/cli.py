"""`mecazen hardware`: real robots, and an emulated one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from mecazen.loading import given_file
from mecazen_tools.cli.options import ScenarioArgument, Settings

app = typer.Typer(no_args_is_help=True, help="Real robots, and an emulated one.")

LINK = Path("/tmp/mecazen-board")  # noqa: S108  # a name of ours, whose owner is checked
"""The emulated board's port, whose own name is not known in advance."""

Port = Annotated[
    str, typer.Option(metavar="PORT", help="Its port.", show_default="the first USB adapter")
]


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
            "unplug@, brownout@, jump@ SECONDS. May be given several times.",
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
