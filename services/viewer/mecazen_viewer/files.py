"""Opens recordings from files."""

from __future__ import annotations

import sys
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

from mecazen.errors import MecazenError

from mecazen_viewer.recorded import draw
from mecazen_viewer.rerun_process import SERVES, SHOWS, RerunProcess, free_port, page, uri


def open_file(file: Path, *, native: bool) -> None:
    """Show a file until its window is closed or until Ctrl-C.

    Raises:
        RerunError: Rerun can't show it here.
    """
    with TemporaryDirectory(prefix="mecazen-view-") as folder:
        shown = [file]
        if file.suffix == ".mcap":
            try:
                shown = draw(file, Path(folder))
            except MecazenError as error:
                sys.stderr.write(f"{error}; shown without the scene\n")
        try:
            if native:
                with closing(RerunProcess("--port=auto", *map(str, shown), ready=SHOWS)) as window:
                    window.wait()
                return
            data, web = free_port("data port", 0), free_port("web port", 0)
            ports = f"--port={data}", f"--web-viewer-port={web}"
            program = RerunProcess("--serve-web", *ports, *map(str, shown), ready=SERVES)
            with closing(program) as server:
                print(f"{file}: {page(web, uri(data))}\nCtrl-C ends it.", flush=True)
                server.wait()
        except KeyboardInterrupt:
            return
