"""Rerun's program as a child process: server, window, viewer without a window.

Rerun's SDK could serve from this process, but it serves its web page only on all interfaces.
"""

from __future__ import annotations

import ctypes
import errno
import os
import signal
import subprocess
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from urllib.parse import urlencode

import rerun_cli
from mecazen.bus import ports
from mecazen.bus.ports import LOOPBACK
from mecazen.config import ViewerConfig
from mecazen.errors import MecazenError
from rerun.experimental import ViewerClient

PROGRAM = Path(rerun_cli.__file__).with_name("rerun")
"""The executable; terminating its Python wrapper would leave it running."""
STOP_TIMEOUT_S = 3.0
PR_SET_PDEATHSIG = 1


class RerunError(MecazenError):
    """Rerun does not start, or has ended."""


class RerunProcess:
    """Rerun's program, which has started once a line of its log contains `ready`.

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


class RerunServer(RerunProcess):
    """A server of data to any number of viewers, and of a web page that shows them.

    Raises:
        RerunError: A port is taken, or Rerun can't listen on the address.
    """

    def __init__(self, config: ViewerConfig, *arguments: str) -> None:
        data_port = free_port("viewer.data_port", config.data_port, config.listen)
        web_port = free_port("viewer.web_port", config.web_port, config.listen)
        listening = f"--port={data_port}", f"--web-viewer-port={web_port}"
        super().__init__(
            *("--serve-web", *listening, *arguments),
            ready="Hosting a web-viewer",
            bind=config.listen,
        )
        self.uri = uri(data_port)
        """URI to which native viewers connect."""
        # the welcome screen would load examples from Rerun's site
        query = urlencode({"url": self.uri})
        self.url = f"http://{LOOPBACK}:{web_port}/?{query}&hide_welcome_screen"


def open_window(*sources: str) -> RerunProcess:
    """Open Rerun's own window, which shows files or the data of `--connect=URI`.

    Raises:
        RerunError: There is no display.
    """
    return RerunProcess("--port=auto", "--hide-welcome-screen", *sources, ready="wgpu adapter")


@contextmanager
def headless_viewer(width: int = 1920, height: int = 1080) -> Iterator[ViewerClient]:
    """Run a viewer without a window of `width` x `height` pixels, for screenshots and tests.

    Raises:
        RerunError: The viewer does not start, e.g. without a Vulkan driver (Debian's
            mesa-vulkan-drivers renders in software).
    """
    port = free_port("port", 0)
    options = f"--port={port}", f"--window-size={width}x{height}", "--hide-welcome-screen"
    with closing(RerunProcess("--headless", *options, ready="Headless viewer running")):
        yield ViewerClient.connect(uri(port))


def free_port(key: str, port: int, address: str = LOOPBACK) -> int:
    """Return `port` if it is free on an address, or any free port for 0.

    Raises:
        RerunError: The port is taken; the message names `key`.
    """
    if not port:
        return ports.free_port()
    try:
        ports.probe(port, address)
    except OSError as error:
        if error.errno not in (errno.EADDRINUSE, errno.EACCES):
            return port  # the address is wrong, which Rerun reports
        reason = os.strerror(error.errno).lower()
        raise RerunError(
            f"{key} = {port}: {reason}; another viewer? (--set {key}=0 takes a free port)"
        ) from None
    return port


def uri(port: int) -> str:
    """Return the URI of the data of a server."""
    return f"rerun+http://{LOOPBACK}:{port}/proxy"
