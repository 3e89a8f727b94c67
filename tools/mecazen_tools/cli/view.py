"""`mecazen view`: opens a recording in Rerun."""

# ruff: noqa: PLC0415 - imported late: Rerun takes half a second

from __future__ import annotations

import sys
from contextlib import closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from mecazen.config import ViewerConfig
from mecazen.errors import ConfigError, MecazenError, is_installed
from mecazen.files import open_regular

MAGIC = b"\x89MCAP0\r\n"
"""First bytes of an MCAP file; Rerun shows an empty page for a file without them."""


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
    with open_regular(file) as content:
        begin = content.read(len(MAGIC))
    if file.suffix == ".mcap" and begin != MAGIC:
        raise ConfigError(f"{file}: not an MCAP file")
    with TemporaryDirectory(prefix="mecazen-view-") as folder:
        files = [str(file)]
        if file.suffix == ".mcap":
            try:
                files = _draw(file, Path(folder))
            except MecazenError as error:
                sys.stderr.write(f"{error}; shown without the scene\n")
        with suppress(KeyboardInterrupt):
            _show(file, files, native=native)


def _draw(file: Path, folder: Path) -> list[str]:
    if not is_installed("recorder"):
        raise MecazenError(f"{file}: its reader needs pip install 'mecazen[recorder]'")
    from mecazen_recorder.reader import Recording
    from mecazen_viewer.service import draw

    from mecazen_tools.cli.recording import report_damage

    recording = Recording(file)
    drawn = draw(recording, folder)
    report_damage(recording)
    return list(map(str, drawn))


def _show(file: Path, files: list[str], *, native: bool) -> None:
    """Show files until the window is closed or the server ends."""
    from mecazen_viewer.rerun_process import RerunServer, open_window

    if native:
        with closing(open_window(*files)) as window:
            window.wait()
        return
    with closing(RerunServer(ViewerConfig(web_port=0, data_port=0), *files)) as server:
        print(f"{file}: {server.url}\nCtrl-C ends it.", flush=True)
        server.wait()
