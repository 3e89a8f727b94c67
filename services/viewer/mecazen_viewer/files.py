"""Shows recordings from files."""

from __future__ import annotations

from pathlib import Path

from mecazen_viewer.rerun_process import SERVES, SHOWS, free_port, page, rerun, uri


def open_file(file: Path, *, native: bool) -> None:
    """Show a file until its window is closed, or until Ctrl-C.

    Raises:
        RerunError: Rerun can't show it here.
    """
    try:
        if native:
            with rerun("--port=auto", str(file), ready=SHOWS) as window:
                window.wait()
            return
        data, web = free_port("data port", 0), free_port("web port", 0)
        ports = f"--port={data}", f"--web-viewer-port={web}"
        with rerun("--serve-web", *ports, str(file), ready=SERVES) as server:
            print(f"{file}: {page(web, uri(data))}\nCtrl-C ends it.", flush=True)
            server.wait()
    except KeyboardInterrupt:
        return
