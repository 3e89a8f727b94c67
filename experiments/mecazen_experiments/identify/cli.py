"""`mecazen identify`: a robot's parameters from recordings with a reference pose."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mecazen.errors import ConfigError
from typer import Argument, Option

Sources = Annotated[
    list[Path] | None,
    Argument(
        metavar="FILE…",
        help="Recordings (MCAP), CSV files, or a folder of sessions.",
        show_default=False,
    ),
]
FormatName = Annotated[
    str | None,
    Option(
        "--format",
        metavar="FORMAT",
        help="mcap, csv or optiodom (a folder).",
        show_default="by suffix",
    ),
]
RobotName = Annotated[
    str, Option("--robot", metavar="ROBOT", help="The robot file from which a fit begins.")
]
Columns = Annotated[
    list[str] | None,
    Option(metavar="NAME=COLUMN", help="Name of a CSV column, e.g. time_s=t.", show_default=False),
]
Out = Annotated[Path, Option(metavar="FOLDER", help="Where report, figures and robot file go.")]
PlanFile = Annotated[
    Path | None,
    Option(
        "--plan", metavar="FILE.csv", help="Write the excitation, and no more.", show_default=False
    ),
]


def identify(
    sources: Sources = None,
    format_: FormatName = None,
    robot: RobotName = "nexus",
    columns: Columns = None,
    out: Out = Path("identified"),
    plan: PlanFile = None,
) -> None:
    """Identify a robot's kinematics and motors; write a report and a robot file.

    Recordings have joint_states, ground_truth/odom and joint_command. A CSV file has the columns
    time_s, x_m, y_m, yaw_rad of the reference, and front_left_rad, front_right_rad, rear_left_rad,
    rear_right_rad, the angles of the wheels. Times may also be in ms, µs or ns, from any moment.

    Example: mecazen identify --format optiodom FOLDER --robot omni4 --out report
    """
    from mecazen_experiments.identify import commands  # noqa: PLC0415  # every start imports this

    if plan is not None:
        commands.write_plan(plan)
    elif not sources:
        raise ConfigError("identify needs recordings, or --plan FILE.csv")
    else:
        commands.identify(sources, format_, robot, columns or (), out)
