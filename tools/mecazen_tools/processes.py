"""Starts the processes of a scenario, watches them, and ends all of them."""

from __future__ import annotations

import math
import os
import queue
import secrets
import signal
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

from mecazen.bus.ports import LOOPBACK, free_port
from mecazen.config import Process, Scenario
from mecazen.errors import ConfigError, MecazenError
from mecazen.graph import OBSERVERS
from mecazen.runtime.report import Report

from mecazen_tools.forking import Child, Parent

STOP_TIMEOUT_S = 5.0
"""Time for a process to end before it is killed [s]."""

STEADY_S = 1.0
"""Time of work below which an ended process has failed, so that its restart waits [s]."""
FIRST_PAUSE_S, MAX_PAUSE_S = 0.5, 8.0
"""Pauses before repeated restarts [s]: the first, which doubles each time, and the longest."""


LAST_LINES_S = 1.0
"""Time to read the log of a process that has ended [s]. Its own subprocesses may keep it open."""

ROUTER = Process(("router",))
"""The Zenoh router."""


class Line(NamedTuple):
    """A line for the user: the log of a process, or its change of state."""

    name: str
    text: str
    is_address: bool = False
    """Whether it is the address of a page that the process serves."""


class Ended(NamedTuple):
    """The end of a process."""

    name: str
    code: int | None
    """None if it ended because the parent of all processes ended."""
    last_line: str
    """The last line of its log."""


@dataclass
class _Part:
    """A process, and the data for its restart."""

    child: Child
    process: Process
    """Its services and robot."""
    needed: bool
    error: str = ""
    """The error that the process reported before its end."""
    has_run: bool = False
    """Whether the process has ever reported that it works."""
    begin_s: float = math.inf
    """Begin of the process's present work [s]; infinite while it does not work."""
    failures: int = 0
    """Number of consecutive ends before `STEADY_S` of work."""
    restart_s: float | None = None
    """Time of its restart [s]."""


class ProcessError(MecazenError):
    """A process of the simulation failed; the message is that of the process."""


class Supervisor:
    """The processes of one scenario.

    All are forked from one parent (see `forking`), each into its own session. So Ctrl-C reaches
    only this process, which then ends the others. If this process dies, the others end as well.

    With `restart` a process that has ended is started again, at once, or after a pause that grows
    while it keeps ending. A process that fails before it has ever run, or because of its scenario,
    is still an error.

    Args:
        path: The scenario's file.
        settings: Its overrides.
        scenario: The scenario loaded from both; left out, each process loads it.
        restart: See above.
    """

    def __init__(
        self,
        path: Path,
        settings: Sequence[str],
        scenario: Scenario | None = None,
        *,
        restart: bool = False,
    ) -> None:
        own = scenario is not None and scenario.programs
        self._fork = partial(Parent, path, settings, None if own else scenario)
        self._restart = restart
        self._parent = self._fork()
        self._parts: dict[str, _Part] = {}
        self._watchers: list[threading.Thread] = []
        self._events: queue.SimpleQueue[Line | Ended | tuple[str, Report]] = queue.SimpleQueue()

    @property
    def pids(self) -> dict[str, int]:
        """The process of each name that was started."""
        return {name: part.child.pid for name, part in self._parts.items()}

    def works(self, name: str) -> bool:
        """Return whether a process had reported by the last `poll` that it works."""
        return self._parts[name].begin_s < math.inf

    def start(self, process: Process, *, needed: bool = True) -> None:
        """Start a process; the service `router` is the router.

        If it is not `needed`, its end is no error.
        """
        self._parts[process.name] = _Part(self._spawn(process), process, needed)

    def _spawn(self, process: Process) -> Child:
        child = self._parent.start(process)
        if child is None:
            self._parent.close()
            self._parent = self._fork()
            child = self._parent.start(process)
        if child is None:
            raise ProcessError("the parent of all processes has ended")
        watcher = threading.Thread(target=self._watch, args=(process.name, child), daemon=True)
        watcher.start()
        self._watchers = [other for other in self._watchers if other.is_alive()]
        self._watchers.append(watcher)
        return child

    def start_router(self, timeout_s: float = 10.0) -> None:
        """Start the router and wait until it listens.

        Raises:
            ProcessError: It ended, most often because the port is taken, or it reports nothing.
        """
        self.start(ROUTER)
        deadline = time.monotonic() + timeout_s
        while not self.works(ROUTER.name):
            left_s = deadline - time.monotonic()
            if left_s <= 0.0:
                raise ProcessError("the router does not start")
            self.poll(left_s)

    def poll(self, timeout_s: float) -> Line | None:
        """Return the next line that a process wrote, or None if none is written in time.

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
            if isinstance(event, Line):
                return event
            if isinstance(event, Ended):
                return self._take_end(event)
            name, report = event
            part = self._parts[name]
            if report.kind == "started":
                part.has_run, part.begin_s = True, time.monotonic()
                if name == ROUTER.name:
                    return Line(name, "the router listens")
            elif report.kind == "failed":
                part.error = report.text
            else:
                return Line(name, report.text, is_address=True)

    def _start_again(self) -> float:
        """Restart the processes that are due; return the monotonic time of the next restart [s]."""
        now = time.monotonic()
        for part in self._parts.values():
            if part.restart_s is not None and part.restart_s <= now:
                part.child = self._spawn(part.process)
                part.restart_s, part.error = None, ""
        return min(
            (p.restart_s for p in self._parts.values() if p.restart_s is not None), default=math.inf
        )

    def _take_end(self, event: Ended) -> Line:
        part = self._parts[event.name]
        # the report of a node begins with its name
        how = _how(event, part.error).removeprefix(f"{event.name}: ")
        worked_s, part.begin_s = time.monotonic() - part.begin_s, math.inf
        # an observer that reported an error, such as a full disk, would report the error again
        hopeless = not part.has_run or (not part.needed and part.error != "")
        is_wrong = event.code == ConfigError.exit_code  # by the scenario, which stays the same
        if not self._restart or is_wrong or (event.code and event.code > 0 and hopeless):
            if part.needed:
                raise ProcessError(f"{event.name}: {how}")
            return Line(event.name, f"{event.name} has ended: {how}; the others go on")
        part.failures = 0 if worked_s >= STEADY_S else part.failures + 1
        pause_s = 0.0
        if part.failures > 1:
            pause_s = min(FIRST_PAUSE_S * 2 ** (part.failures - 2), MAX_PAUSE_S)
        part.restart_s = time.monotonic() + pause_s
        when = f"in {pause_s:g} s" if pause_s else "at once"
        return Line(event.name, f"{event.name}: {how}; it is started again {when}")

    def stop(self) -> list[str]:
        """End all processes; return the names of those that had to be killed.

        Observers end after all others, so that they receive all samples.
        """
        last = {ROUTER.name, *OBSERVERS}
        killed = [*self._stop(self._parts.keys() - last), *self._stop(self._parts.keys() & last)]
        for watcher in self._watchers:
            watcher.join()
        self._parent.close()
        return killed

    def _stop(self, names: Set[str]) -> list[str]:
        children = {name: self._parts[name].child for name in sorted(names)}
        children = {name: child for name, child in children.items() if not child.ended.is_set()}
        for child in children.values():
            self._parent.signal(child.pid, signal.SIGTERM)
        killed = []
        for name, child in children.items():
            if not child.ended.wait(STOP_TIMEOUT_S):
                self._parent.signal(child.pid, signal.SIGKILL)
                child.ended.wait()
                killed.append(name)
        return killed

    def _watch(self, name: str, child: Child) -> None:
        last: deque[str] = deque(maxlen=1)
        reader = threading.Thread(target=self._read, args=(name, child, last), daemon=True)
        reader.start()
        while (report := child.next_report()) is not None:
            self._events.put((name, report))
        reader.join(LAST_LINES_S)
        self._events.put(Ended(name, child.code, last[0] if last else ""))

    def _read(self, name: str, child: Child, last: deque[str]) -> None:
        with child.errors:
            for line in child.errors:
                last.append(line.rstrip())
                self._events.put(Line(name, last[0]))


def _how(event: Ended, error: str) -> str:
    """Return in one line how a process has ended."""
    if event.code is None:
        return "has ended with the parent of all processes"
    if event.code < 0:
        return f"was killed by {signal.Signals(-event.code).name}"
    return error or event.last_line or f"ended with code {event.code}"


def private_router(protocol: Literal["tcp", "tls"] = "tcp") -> tuple[str, ...]:
    """Return settings for a router at a free port and a namespace of its own.

    So several runs, also one of `mecazen up`, do not receive each other's samples.
    """
    return (
        f'bus.connect=["{protocol}/{LOOPBACK}:{free_port()}"]',
        f"bus.namespace=run{secrets.token_hex(4)}",
    )


@contextmanager
def on_one_core() -> Iterator[None]:
    """Let processes that are started within this context share one core, and take turns on it.

    The parts of a tick in lockstep run one after the other. On one core no process has to be woken
    on another core, which is the larger part of a hop's time: on several cores a distributed run of
    `back` makes 29 % fewer ticks a second. The policy for batch processes lets a sender finish
    sending before a receiver takes over: without this policy the run makes 17 % fewer ticks. A
    policy that the user has chosen, as with `chrt`, is kept.
    """
    is_default = os.sched_getscheduler(0) == os.SCHED_OTHER
    if is_default:
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    try:
        with _on({max(os.sched_getaffinity(0))}):
            yield
    finally:
        if is_default:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@contextmanager
def beside_that_core() -> Iterator[None]:
    """Let threads that are started within this context avoid the core of the processes."""
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
