"""Opens recordings from files."""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from mecazen.errors import MecazenError

from mecazen_viewer.recorded import draw
from mecazen_viewer.rerun_process import SERVES, SHOWS, free_port, page, rerun, uri


def open_file(file: Path, *, native: bool) -> None:
    """Show a file until its window is closed or until Ctrl-C.

    Raises:
        RerunError: Rerun can't show it here.
    """
    with TemporaryDirectory(prefix="mecazen-view-") as folder:
        shown = _drawn(file, Path(folder)) if file.suffix == ".mcap" else [file]
        try:
            if native:
                with rerun("--port=auto", *map(str, shown), ready=SHOWS) as window:
                    window.wait()
                return
            data, web = free_port("data port", 0), free_port("web port", 0)
            ports = f"--port={data}", f"--web-viewer-port={web}"
            with rerun("--serve-web", *ports, *map(str, shown), ready=SERVES) as server:
                print(f"{file}: {page(web, uri(data))}\nCtrl-C ends it.", flush=True)
                server.wait()
        except KeyboardInterrupt:
            return


def _drawn(file: Path, folder: Path) -> list[Path]:
    """Return the scene of a recording, or the file itself if it can't be drawn."""
    try:
        return draw(file, folder)
    except MecazenError as error:
        sys.stderr.write(f"{error}; shown without the scene\n")
        return [file]
