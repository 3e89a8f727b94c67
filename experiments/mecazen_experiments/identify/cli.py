"""`mecazen identify`: a robot's parameters from recordings with a reference pose."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from mecazen.loading import given_file, load_table
from mecazen.robot import Robot
from mecazen_tools.cli.options import Topics
from typer import Argument, Option

# every start of `mecazen` imports this module: the functions import what is slow


def identify(
    sources: Annotated[
        list[Path],
        Argument(
            metavar="FILE…",
            help="Recordings (MCAP, db3), CSV files, or folders of sessions.",
            show_default=False,
        ),
    ],
    robot: Annotated[
        str, Option(metavar="ROBOT", help="The robot file from which a fit begins.")
    ] = "nexus",
    out: Annotated[Path, Option(metavar="FOLDER", help="Folder for report and robot file.")] = Path(
        "identified"
    ),
    topics: Topics = "",
    *,
    validate: Annotated[
        bool,
        Option(
            "--validate",
            help="Fit to every second session, and report the drift on the other sessions.",
        ),
    ] = False,
) -> None:
    """Identify a robot's kinematics and motors; write a report and a robot file.

    Recordings need joint_states and ground_truth/odom, and joint_command for the motors. A CSV
    file needs the reference (columns time_s, x_m, y_m, yaw_rad) and the angles of the wheels
    (front_left_rad, front_right_rad, rear_left_rad, rear_right_rad). docs/recording.md lists other
    units.

    With --validate, models and the full simulation are compared by their drift from the reference.

    Example: mecazen identify FOLDER --robot omni4 --out report
    """
    # every start of `mecazen` imports this module
    from mecazen_tools import files  # noqa: PLC0415

    from mecazen_experiments.identify import data, identification  # noqa: PLC0415
    from mecazen_experiments.identify import validate as validation  # noqa: PLC0415

    base = load_table(given_file(robot, "robot"), Robot)
    runs, logs = data.read(sources, topics, base.wheels.joints)
    files.make_folder(out, "--out")
    if validate:
        result, changed, drifts = validation.validate(base, runs)
        lines = [*validation.validation_lines(result, drifts)]
        typer.echo("\n".join(lines))
    else:
        result = identification.identify(base, runs, logs)
        changed = validation.identified_robot(base, result, runs[0])
        lines = [*identification.identification_lines(result)]
        gain = identification.interval(result.parameters[-1]["lateral_gain"], ".4f")
        typer.echo(f"lateral gain: {gain}, nearest to that of {result.rollers} rollers")
        for note in result.notes:
            typer.echo(note, err=True)
    name = "validation.md" if validate else "report.md"
    files.write(out / name, ("\n".join(lines) + "\n").encode(), "--out")
    files.write(out / "robot.toml", identification.robot_file(changed, result).encode(), "--out")
    typer.echo(f"{out / name}\n{out / 'robot.toml'}")
