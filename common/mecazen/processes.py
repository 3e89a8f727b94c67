"""Starts the processes of a scenario, watches them, and ends all of them."""

from __future__ import annotations

import os
import queue
import secrets
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, NamedTuple

from mecazen.errors import MecazenError

STOP_TIMEOUT_S = 5.0
"""How long a process may take to end before it is killed."""


class Line(NamedTuple):
    """A line that a process has written."""

    name: str
    text: str


class Ended(NamedTuple):
    """The end of a process."""

    name: str
    code: int
    error: str
    """Its last words; where it failed as it may, the one line that says why."""


class ProcessError(MecazenError):
    """A process of the simulation failed; the message is its own."""


class Supervisor:
    """The processes of one scenario.

    Each runs `python -m mecazen.runtime` in a session of its own, so that Ctrl-C reaches
    only this process, which then ends them; and ends by itself if this process dies.
    """

    def __init__(self, scenario: Path, settings: Sequence[str]) -> None:
        self._arguments = [str(scenario), *(f"--set={setting}" for setting in settings)]
        self._processes: dict[str, subprocess.Popen[str]] = {}
        self._needed: set[str] = set()
        self._watchers: list[threading.Thread] = []
        self._events: queue.SimpleQueue[Line | Ended] = queue.SimpleQueue()

    @property
    def pids(self) -> dict[str, int]:
        """The process of each name that was started."""
        return {name: process.pid for name, process in self._processes.items()}

    def start(self, name: str, *, needed: bool = True) -> None:
        """Start a service, or the `router`; where it is not `needed`, its end is no error."""
        (self._needed.add if needed else self._needed.discard)(name)
        command = [sys.executable, "-m", "mecazen.runtime", name, *self._arguments]
        process = subprocess.Popen(
            [*command, "--until-orphaned"],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self._processes[name] = process
        watcher = threading.Thread(target=self._watch, args=(name, process), daemon=True)
        watcher.start()
        self._watchers.append(watcher)

    def start_router(self, timeout_s: float = 10.0) -> None:
        """Start the router and wait until it listens.

        Raises:
            ProcessError: It ended, most often because the port is taken, or says nothing.
        """
        self.start("router")
        while (event := self.poll(timeout_s)) is not None:
            if isinstance(event, Line) and "msg=started" in event.text:
                return
        raise ProcessError("the router does not start")

    def poll(self, timeout_s: float) -> Line | None:
        """Return the next line that a process wrote, or None when there is none in time.

        Raises:
            ProcessError: A process that is needed has ended and was not told to.
        """
        try:
            event = (
                self._events.get(timeout=timeout_s) if timeout_s > 0 else self._events.get_nowait()
            )
        except queue.Empty:
            return None
        if isinstance(event, Line):
            return event
        error = event.error.removeprefix("error: ") or f"ended with code {event.code}"
        if event.name not in self._needed:
            return Line(event.name, f"{event.name} has ended; the others go on")
        raise ProcessError(f"{event.name}: {error}")

    def stop(self) -> list[str]:
        """End all processes; return the names of those that had to be killed."""
        for process in self._processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        killed = []
        for name, process in self._processes.items():
            try:
                process.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                killed.append(name)
        for watcher in self._watchers:
            watcher.join()
        return killed

    def _watch(self, name: str, process: subprocess.Popen[str]) -> None:
        last = ""
        if process.stderr is not None:
            with process.stderr:
                for line in process.stderr:
                    last = line.rstrip()
                    self._events.put(Line(name, last))
        code = process.wait()
        if process.stdin is not None:
            process.stdin.close()
        self._events.put(Ended(name, code, last))


def private_meeting_point(protocol: Literal["tcp", "tls"] = "tcp") -> tuple[str, ...]:
    """Return settings by which processes meet at a free port, under a namespace of their own.

    Several runs, and one that is `up`, then do not hear each other.
    """
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    return (
        f'bus.connect=["{protocol}/127.0.0.1:{port}"]',
        f"bus.namespace=run{secrets.token_hex(4)}",
    )


@contextmanager
def on_one_core() -> Iterator[None]:
    """Let processes that are started meanwhile share one core, and take turns on it.

    The parts of a tick in lockstep come one after the other: on one core none has to be
    woken on another, which is the larger part of a hop's time. As batch processes they let
    a sender finish what it sends before a receiver takes over: a third of the switches.
    """
    policy = os.sched_getscheduler(0)
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    try:
        with _on({max(os.sched_getaffinity(0))}):
            yield
    finally:
        os.sched_setscheduler(0, policy, os.sched_param(0))


@contextmanager
def beside_that_core() -> Iterator[None]:
    """Let threads that are started meanwhile keep off the core that the processes share."""
    cores = os.sched_getaffinity(0)
    with _on(cores - {max(cores)} or cores):
        yield


@contextmanager
def _on(cores: set[int]) -> Iterator[None]:
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
