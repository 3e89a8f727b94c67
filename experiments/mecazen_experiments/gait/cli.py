"""`mecazen gait`: the gait of a recorded walk."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from mecazen_tools.cli.options import RecordingFile, Topics, console


def gait(
    file: RecordingFile,
    run: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="Number of the run; see mecazen info.", show_default="the last"
        ),
    ] = None,
    robot: Annotated[
        str,
        typer.Option(metavar="NAME", help="The robot, if there are several.", show_default=False),
    ] = "",
    export: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write TRC, CSV and JSON files to this folder, and C3D with the extra c3d.",
            show_default="none",
        ),
    ] = None,
    topics: Topics = "",
) -> None:
    """Report the longest walk of a recorded person, and write it for gait laboratories.

    The recording needs odom and skeleton/observation.

    Examples: mecazen gait run.mcap · mecazen gait run.mcap --export walk
    """
    # every start of `mecazen` imports this module
    from mecazen_recorder.foreign import open_recording  # noqa: PLC0415

    from mecazen_experiments.gait import report  # noqa: PLC0415
    from mecazen_experiments.gait.stages import read_walk  # noqa: PLC0415

    stages, about = read_walk(open_recording(file, topics), run, robot)
    about = {"recording": file.name, **about}
    console(100).print(*report.report(stages, about), sep="\n")
    if export is not None:
        for written in report.export(export, stages, about):
            typer.echo(written)
