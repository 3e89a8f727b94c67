"""A native viewer without a window, for screenshots and tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rerun.experimental import ViewerClient

from mecazen_viewer.rerun_process import free_port, rerun, uri

READY = "Headless viewer running"


@contextmanager
def headless_viewer(width: int = 1920, height: int = 1080) -> Iterator[ViewerClient]:
    """Run a viewer of `width` x `height` pixels within the context.

    Raises:
        RerunError: It does not start, e.g. without a Vulkan driver (Debian's
            mesa-vulkan-drivers renders in software).
    """
    port = free_port("port", 0)
    size = f"--window-size={width}x{height}"
    with rerun("--headless", f"--port={port}", size, "--hide-welcome-screen", ready=READY):
        yield ViewerClient.connect(uri(port))
