"""`mecazen robot`: your robot from its description."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from mecazen.errors import ConfigError
from mecazen.loading import given_file, load_table, parse_settings
from mecazen.robot import Robot
from rich.table import Table
from typer import Argument, Option

from mecazen_tools import drawing, files
from mecazen_tools.cli.options import console, output
from mecazen_tools.description import read_description
from mecazen_tools.robot_import import Controller, controller_of, import_robot, read_controller

app = typer.Typer(no_args_is_help=True, help="Your robot: its description, drawing and gains.")


@app.command("import")
def import_(
    file: Annotated[
        Path,
        Argument(metavar="FILE", help="URDF, .xacro, SDF or MJCF."),
    ],
    controller: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="Parameters of ros2_controllers in YAML, or SDF with gz-sim's MecanumDrive.",
        ),
    ] = None,
    output: Annotated[
        Path | None, output("The robot file to write.", "the robot's name, with .toml")
    ] = None,
    arguments: Annotated[
        list[str] | None,
        Option("--arg", metavar="NAME:=VALUE", help="An argument of a xacro. Repeatable."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        Option(
            "--set",
            metavar="KEY=VALUE",
            help="A value of the robot file, e.g. rollers.count=12. Repeatable.",
        ),
    ] = None,
) -> None:
    """Write the robot file of a robot that is described for ROS, Gazebo or MuJoCo.

    Examples: mecazen robot import my_robot.urdf ·
    mecazen robot import my_robot.urdf.xacro --arg use_sim:=true --controller controllers.yaml
    """
    pairs = [argument.partition(":=") for argument in arguments or ()]
    for pair, argument in zip(pairs, arguments or (), strict=True):
        if not pair[1] or not pair[0]:
            raise ConfigError(f"--arg {argument}: must be name:=value")
    description = read_description(file, {name: value for name, _, value in pairs})
    numbers = Controller()
    if controller is not None:
        numbers = read_controller(controller)
    elif description.plugin:
        numbers = controller_of(description.plugin, file)
    changes = parse_settings(settings or ())
    imported, toml, notes = import_robot(file, description, numbers, changes)
    path = output or Path(f"{imported.name}.toml")
    if path.exists():
        raise ConfigError(f"{path}: exists already, and is not overwritten")
    files.write(path, toml.encode(), "--output")
    for note in notes:
        typer.echo(note)
    typer.echo(f"{path}: written; next:\n  mecazen simulate back --set robot={path}")


@app.command()
def show(
    robot: Annotated[
        str,
        Argument(metavar="ROBOT", help="A robot file, or its name in configs/robots."),
    ],
    output: Annotated[
        Path | None, output("The picture: .png, .svg or .pdf.", "the robot's name, with .png")
    ] = None,
) -> None:
    """Draw a robot with its dimensions, and compare its speeds in four drives with formulas.

    Example: mecazen robot show my_robot.toml
    """
    loaded = load_table(file := given_file(robot, "robot"), Robot)
    picture = output or Path(f"{loaded.name}.png")
    drawing.refuse_undrawable(picture, "--output")
    from mecazen_tools.robot_show import draw, gains  # noqa: PLC0415  # needs Matplotlib

    drawing.save(draw(loaded), picture, "--output")
    typer.echo(f"{picture}: written")
    table = Table("drive", "speed / commanded", "formula")
    for check, measured, formula in gains(loaded, file):
        table.add_row(check, f"{measured:.4f}", f"{formula:.4f}")
    console(100).print(table)
