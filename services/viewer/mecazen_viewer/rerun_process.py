"""Rerun's program as a child process: server, viewer, screenshots.

Rerun's SDK could serve from this process, but it serves its web page only on all interfaces.
"""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import subprocess
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from urllib.parse import urlencode

import rerun_cli
from mecazen.bus import ports
from mecazen.bus.ports import LOOPBACK
from mecazen.errors import MecazenError
from rerun.experimental import ViewerClient

PROGRAM = Path(rerun_cli.__file__).with_name("rerun")
"""The executable; terminating its Python wrapper would leave it running."""
SERVES, SHOWS, HEADLESS = "Hosting a web-viewer", "wgpu adapter", "Headless viewer running"
"""Log lines that show that Rerun serves, that its window is open, and that it runs headless."""
WINDOW = "--port=auto", "--hide-welcome-screen"
"""Arguments for a window that does not download examples."""
STOP_TIMEOUT_S = 3.0
PR_SET_PDEATHSIG = 1


class RerunError(MecazenError):
    """Rerun does not start, or has ended."""


class RerunProcess:
    """Rerun's program, started once its log contains `ready`.

    Raises:
        RerunError: The program ended before that.
    """

    def __init__(self, *arguments: str, ready: str, bind: str = LOOPBACK) -> None:
        libc = ctypes.CDLL(None)
        self._process = subprocess.Popen(
            [PROGRAM, f"--bind={bind}", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            # CI disables its telemetry
            env={**os.environ, "CI": "1", "NO_COLOR": "1", "RUST_LOG": "info"},
            # Ctrl-C must reach only this process, which terminates the child ...
            start_new_session=True,
            # ... and the child dies with this process, however that ends
            preexec_fn=lambda: libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL),  # noqa: PLW1509
        )
        assert self._process.stderr is not None
        self._stderr = self._process.stderr
        self.pid = self._process.pid
        self._last = ""
        if not any(ready in line for line in self._lines()):
            self._process.wait()
            self._stderr.close()
            self.check()
        # the child would block on a full pipe
        self._reader = threading.Thread(target=lambda: [None for _ in self._lines()], daemon=True)
        self._reader.start()

    def check(self) -> None:
        """Raise RerunError if the program has ended."""
        code = self._process.poll()
        if code is not None:
            raise RerunError(f"rerun has ended: {self._last or f'code {code}'}")

    def wait(self) -> None:
        """Wait until the program ends by itself, e.g. when its window is closed."""
        self._process.wait()

    def close(self) -> None:
        """Terminate the program."""
        self._process.terminate()
        try:
            self._process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        self._stderr.close()

    def _lines(self) -> Iterator[str]:
        for line in self._stderr:
            if not self._last.startswith("error: "):  # hints follow it
                self._last = line.strip() or self._last
            yield line


@contextmanager
def headless_viewer(width: int = 1920, height: int = 1080) -> Iterator[ViewerClient]:
    """Run a viewer without a window of `width` x `height` pixels, for screenshots and tests.

    Raises:
        RerunError: The viewer does not start, e.g. without a Vulkan driver (Debian's
            mesa-vulkan-drivers renders in software).
    """
    port = free_port("port", 0)
    size = f"--window-size={width}x{height}", "--hide-welcome-screen"
    with closing(RerunProcess("--headless", f"--port={port}", *size, ready=HEADLESS)):
        yield ViewerClient.connect(uri(port))


def free_port(key: str, wanted: int) -> int:
    """Return `wanted` if that port is free, or any free port for 0.

    Raises:
        RerunError: The port is taken; the message names `key`.
    """
    if not wanted:
        return ports.free_port()
    try:
        with socket.create_server((LOOPBACK, wanted)):
            return wanted
    except OSError as error:
        reason = os.strerror(error.errno or 0).lower()
        raise RerunError(
            f"{key} = {wanted}: {reason}; another viewer? (--set {key}=0 takes a free port)"
        ) from None


def uri(port: int) -> str:
    """Return the URI of the data of a server."""
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


def page(port: int, server: str) -> str:
    """Return the address of the web page that shows the data of the server at a URI."""
    # the welcome screen would load examples from Rerun's site
    return f"http://{LOOPBACK}:{port}/?{urlencode({'url': server})}&hide_welcome_screen"
