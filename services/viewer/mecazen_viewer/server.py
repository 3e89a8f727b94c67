"""Serves runs to any number of viewers, which may connect at any time."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager

import rerun as rr
import rerun.blueprint as rrb
from mecazen.config import ViewerConfig

from mecazen_viewer.rerun_process import (
    SHOWS,
    WINDOW,
    RerunError,
    RerunProcess,
    free_port,
    page,
    uri,
)
from mecazen_viewer.web import served_page

logger = logging.getLogger(__name__)

BUFFER = "32MiB"
"""Size of the history for viewers that connect late: some minutes; the oldest data is dropped
first."""


class Server:
    """A server of the newest data of all runs, and a web page that shows them."""

    def __init__(
        self, process: RerunProcess, data_port: int, web_port: int, layout: rrb.Blueprint
    ) -> None:
        self.uri = uri(data_port)
        """URI to which native viewers connect."""
        self.url = page(web_port, self.uri)
        """Address of the web page."""
        self.check = process.check
        self._layout: rrb.Blueprint | None = layout

    def take(self, recording: rr.RecordingStream) -> None:
        """Serve a new recording; attached viewers switch to it."""
        recording.connect_grpc(self.uri, default_blueprint=self._layout)
        # sent once: the server keeps the layout for all runs, and a viewer keeps its user's changes
        self._layout = None


@contextmanager
def serving(config: ViewerConfig, layout: rrb.Blueprint) -> Iterator[Server]:
    """Serve within the context, with a layout, and open a window if configured.

    Raises:
        RerunError: A port is taken.
    """
    data = free_port("viewer.data_port", config.data_port)
    web = free_port("viewer.web_port", config.web_port)
    memory = f"--server-memory-limit={BUFFER}"
    with ExitStack() as processes:
        process = processes.enter_context(served_page(data, web, memory, listen=config.listen))
        server = Server(process, data, web, layout)
        if config.native:
            try:
                window = RerunProcess(*WINDOW, f"--connect={server.uri}", ready=SHOWS)
                processes.enter_context(closing(window))
            except RerunError as error:
                logger.warning("msg=%r", f"no window: {error}")
        yield server
