"""Starts the processes of a scenario, watches them, and ends all of them."""

from __future__ import annotations

import ctypes
import math
import os
import queue
import secrets
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from mecazen.config import join_key
from mecazen.errors import MecazenError

STOP_TIMEOUT_S = 5.0
"""How long a process may take to end before it is killed."""

STEADY_S = 1.0
"""A process that has not worked for so long before it ends has failed: its restart waits ..."""
FIRST_PAUSE_S, MAX_PAUSE_S = 0.5, 8.0
"""... so long at first, twice as long each time it is so again, and at most so long."""

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1"}
"""NumPy's further threads have nothing to do, and each spins for 0.1 s when a process starts."""
ADDR_NO_RANDOMIZE = 0x0040000
"""Linux' personality(2): programs find their code where every other run of them does."""


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


@dataclass
class _Part:
    """A process, and what it takes to start it again."""

    process: subprocess.Popen[str]
    arguments: Sequence[str]
    """What says which one it is: its service, and its robot where there are several."""
    needed: bool
    has_run: bool = False
    """Whether it has ever got so far as to work."""
    begin_s: float = math.inf
    """Since when it works, now."""
    failures: int = 0
    """How often in a row it ended before it had worked for a while."""
    restart_s: float | None = None
    """When it is to be started again."""


class ProcessError(MecazenError):
    """A process of the simulation failed; the message is its own."""


class Supervisor:
    """The processes of one scenario.

    Each runs `python -m mecazen.runtime` in a session of its own, so that Ctrl-C reaches
    only this process, which then ends them; and ends by itself if this process dies.

    Args:
        scenario: The scenario's file.
        settings: Overrides, as of `load_scenario`.
        restart: Start a process again that has ended, at once, or after a pause that grows
            while it keeps ending. What fails before it has ever run is an error still.
    """

    def __init__(self, scenario: Path, settings: Sequence[str], *, restart: bool = False) -> None:
        self._arguments = [str(scenario), *(f"--set={setting}" for setting in settings)]
        self._restart = restart
        self._parts: dict[str, _Part] = {}
        self._watchers: list[threading.Thread] = []
        self._events: queue.SimpleQueue[Line | Ended] = queue.SimpleQueue()

    @property
    def pids(self) -> dict[str, int]:
        """The process of each name that was started."""
        return {name: part.process.pid for name, part in self._parts.items()}

    def start(self, service: str, robot: str = "", *, needed: bool = True) -> None:
        """Start a service, of one of several robots, or the `router`.

        Where it is not `needed`, its end is no error.
        """
        name = join_key(service, robot)
        arguments = (service, f"--robot={robot}")
        self._parts[name] = _Part(self._spawn(name, arguments), arguments, needed)

    def _spawn(self, name: str, arguments: Sequence[str]) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "mecazen.runtime", *arguments, *self._arguments]
        process = subprocess.Popen(
            [*command, "--until-orphaned"],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            env=ONE_THREAD | os.environ,
        )
        watcher = threading.Thread(target=self._watch, args=(name, process), daemon=True)
        watcher.start()
        self._watchers = [other for other in self._watchers if other.is_alive()]
        self._watchers.append(watcher)
        return process

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
            ProcessError: A process that is needed has ended, and is not started again.
        """
        end = time.monotonic() + timeout_s
        while True:
            due_s = self._start_again()
            try:
                wait_s = min(end, due_s) - time.monotonic()
                event = self._events.get(wait_s > 0, timeout=max(wait_s, 0.0))
            except queue.Empty:
                if time.monotonic() >= end:
                    return None
                continue
            if isinstance(event, Ended):
                return self._take_end(event)
            if "msg=started" in event.text:
                part = self._parts[event.name]
                part.has_run, part.begin_s = True, time.monotonic()
            return event

    def _start_again(self) -> float:
        """Start again what is due; return when the next is [s], of the monotonic clock."""
        now = time.monotonic()
        for name, part in self._parts.items():
            if part.restart_s is not None and part.restart_s <= now:
                part.process = self._spawn(name, part.arguments)
                part.begin_s, part.restart_s = math.inf, None
        return min(
            (p.restart_s for p in self._parts.values() if p.restart_s is not None), default=math.inf
        )

    def _take_end(self, event: Ended) -> Line:
        part = self._parts[event.name]
        how = _how(event)
        # an onlooker that tells why it can't go on, as on a full disk, would tell it again
        hopeless = not part.has_run or (not part.needed and event.error.startswith("error: "))
        if not self._restart or (event.code > 0 and hopeless):
            if part.needed:
                raise ProcessError(f"{event.name}: {how}")
            return Line(event.name, f"{event.name} has ended; the others go on")
        now = time.monotonic()
        steady = now - part.begin_s >= STEADY_S
        part.failures = 0 if steady else part.failures + 1
        pause_s = 0.0
        if part.failures > 1:
            pause_s = min(FIRST_PAUSE_S * 2 ** (part.failures - 2), MAX_PAUSE_S)
        part.restart_s = now + pause_s
        when = f"in {pause_s:g} s" if pause_s else "at once"
        return Line(event.name, f"{event.name}: {how}; it is started again {when}")

    def stop(self) -> list[str]:
        """End all processes; return the names of those that had to be killed."""
        processes = {name: part.process for name, part in self._parts.items()}
        for process in processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        killed = []
        for name, process in processes.items():
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


def _how(event: Ended) -> str:
    """Return in one line how a process has ended."""
    if event.code < 0:
        return f"was killed by {signal.Signals(-event.code).name}"
    return event.error.removeprefix("error: ") or f"ended with code {event.code}"


def private_router(protocol: Literal["tcp", "tls"] = "tcp") -> tuple[str, ...]:
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
    a sender finish what it sends before a receiver takes over: a third of the switches. With
    Python at the same addresses in all of them, what the core has learnt of its branches in
    one serves the next: a fifth of the time of a tick.
    """
    policy = os.sched_getscheduler(0)
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    try:
        with _on({max(os.sched_getaffinity(0))}), _at_the_same_addresses():
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


@contextmanager
def _at_the_same_addresses() -> Iterator[None]:
    """Let programs that are started meanwhile lie where they always do, if that is allowed.

    In a container it may not be; then they lie anywhere, as without this.
    """
    personality = ctypes.CDLL(None).personality
    before = personality(0xFFFFFFFF)  # which changes nothing
    personality(before | ADDR_NO_RANDOMIZE)
    try:
        yield
    finally:
        personality(before)
