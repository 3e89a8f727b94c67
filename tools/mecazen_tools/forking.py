"""The fork server of `multiprocessing`, whose processes share the modules that it has imported.

Ctrl-C in a terminal reaches this program and the server. Only this program ends processes. So the
server blocks the signals that ask to end, and a process blocks them until it has its own session.
The server ends with this program, even if this program is killed.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import forkserver, get_context, resource_tracker
from types import ModuleType

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that ask a process to end."""

CONTEXT = get_context("forkserver")
IMPORTED = [
    "mecazen_tools.processes",
    "mecazen_physics.node",
    "mecazen_controller.node",
    "mecazen_target.node",
    "mecazen_follower.node",
    "mecazen_follower.perception",
]
"""Modules that the server imports, if they are installed: those of most scenarios. Reading them
from the graph would delay the start of the server by the import of the graph."""


def start_server() -> None:
    """Start the server, unless it runs. It imports at the same time as this program."""
    CONTEXT.set_forkserver_preload(IMPORTED)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # else it has threads, which a fork would not have
    resource_tracker.ensure_running()  # the server would start it, and unblock the signals
    with starting():
        forkserver.ensure_running()


@contextmanager
def starting() -> Iterator[None]:
    """Start a process undisturbed by signals, and without the program that this process runs.

    A process would import the program, such as the command line, although it needs none of it.
    """
    program = sys.modules["__main__"]
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = program
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
