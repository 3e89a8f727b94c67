"""`mecazen identify`: a robot's parameters from recordings with a reference pose."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

Sources = Annotated[
    list[Path],
    Argument(
        metavar="FILE…", help="Recordings: a folder of sessions, or CSV files.", show_default=False
    ),
]
FormatName = Annotated[
    str, Option("--format", metavar="FORMAT", help="optiodom (a folder) or csv.")
]
RobotName = Annotated[
    str, Option("--robot", metavar="ROBOT", help="The robot file from which a fit begins.")
]
Columns = Annotated[
    list[str] | None,
    Option(metavar="NAME=COLUMN", help="Name of a CSV column, e.g. time_s=t.", show_default=False),
]
Out = Annotated[Path, Option(metavar="FOLDER", help="Where report, figures and robot file go.")]


def identify(
    sources: Sources,
    format_: FormatName = "csv",
    robot: RobotName = "omni4",
    columns: Columns = None,
    out: Out = Path("identified"),
) -> None:
    """Identify a robot's kinematics, and write a report and a robot file.

    A CSV file has the columns time_s, x_m, y_m, yaw_rad of the reference, and front_left_rad,
    front_right_rad, rear_left_rad, rear_right_rad, the angles of the wheels.

    Example: mecazen identify --format optiodom FOLDER --robot omni4 --out report
    """
    from mecazen_experiments.identify import commands  # noqa: PLC0415  # every start imports this

    commands.identify(sources, format_, robot, columns or (), out)
