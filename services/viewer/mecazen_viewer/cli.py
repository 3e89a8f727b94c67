"""`mecazen view`: opens a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from mecazen.errors import ConfigError


def view(
    file: Annotated[
        Path, typer.Argument(help="A recording: .rrd, .mcap or what else Rerun reads.")
    ],
    native: Annotated[
        bool, typer.Option("--native", help="In Rerun's own window instead of the browser.")
    ] = False,
) -> None:
    """Open a recording in Rerun, until Ctrl-C.

    Of what `mecazen record` has written it draws the scene as of a live run.

    Examples: mecazen view run.mcap · mecazen view run.rrd --native
    """
    if not file.is_file():
        raise ConfigError(f"{file}: no such file")
    # only now: Rerun takes half a second to import
    from mecazen_viewer.files import open_file  # noqa: PLC0415

    open_file(file, native=native)
