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

from mecazen_tools.cli.options import RecordedScenario, Topics

MAGIC = b"\x89MCAP0\r\n"
"""First bytes of an MCAP file; Rerun shows an empty page for a file without them."""


def view(
    file: Annotated[
        Path, typer.Argument(help="A recording, or any file that Rerun reads: .rrd, …")
    ],
    native: Annotated[
        bool, typer.Option("--native", help="Use Rerun's own window instead of the browser.")
    ] = False,
    topics: Topics = "",
    scenario: RecordedScenario = None,
) -> None:
    """Open a recording in Rerun, until Ctrl-C.

    A recording is drawn with the scene of a live run, if its scenario is known.

    Examples: mecazen view run.mcap · mecazen view run.rrd --native ·
    mecazen view bag --scenario back --topics ground_truth/odom=/mocap/pose
    """
    from mecazen_viewer.rerun_process import RerunServer, open_window

    if not file.exists():
        raise ConfigError(f"{file}: no such file")
    if file.suffix == ".mcap":
        with open_regular(file) as content:
            if content.read(len(MAGIC)) != MAGIC:
                raise ConfigError(f"{file}: not an MCAP file")
    with TemporaryDirectory(prefix="mecazen-view-") as folder:
        files = [str(file)]
        if file.suffix in (".mcap", ".db3", ".csv") or file.is_dir():
            try:
                files = _draw(file, Path(folder), topics, scenario)
            except MecazenError as error:
                if file.suffix != ".mcap":  # Rerun reads no other format
                    raise
                sys.stderr.write(f"{error}; shown without the scene\n")
        with suppress(KeyboardInterrupt):
            if native:
                with closing(open_window(*files)) as window:
                    window.wait()
                return
            with closing(RerunServer(ViewerConfig(web_port=0, data_port=0), *files)) as server:
                print(f"{file}: {server.url}\nCtrl-C ends it.", flush=True)
                server.wait()


def _draw(file: Path, folder: Path, topics: str, scenario: str | None) -> list[str]:
    if not is_installed("recorder"):
        raise MecazenError(f"{file}: its reader needs pip install 'mecazen[recorder]'")
    from mecazen_recorder.foreign import open_recording
    from mecazen_viewer.service import draw

    from mecazen_tools.cli.recording import report_damage

    recording = open_recording(file, topics, scenario)
    drawn = draw(recording, folder)
    report_damage(recording)
    return list(map(str, drawn))
