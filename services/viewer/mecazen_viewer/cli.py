"""`mecazen view`: opens a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from mecazen.errors import ConfigError


def view(
    file: Annotated[
        Path, typer.Argument(help="A recording: .rrd, .mcap or any file that Rerun reads.")
    ],
    native: Annotated[
        bool, typer.Option("--native", help="In Rerun's own window instead of the browser.")
    ] = False,
) -> None:
    """Open a recording in Rerun, until Ctrl-C.

    A recording of `mecazen record` is drawn with the scene of a live run.

    Examples: mecazen view run.mcap · mecazen view run.rrd --native
    """
    if not file.is_file():
        raise ConfigError(f"{file}: no such file")
    # imported late: Rerun takes half a second
    from mecazen_viewer.recorded import open_file  # noqa: PLC0415

    open_file(file, native=native)
