"""Starts the processes of a scenario, watches them, and ends all of them."""

from __future__ import annotations

import gc
import math
import os
import re
import secrets
import signal
import threading
import time
from collections import deque
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import FileIO
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from selectors import EVENT_READ, DefaultSelector
from typing import Literal, NamedTuple

from mecazen.bus.ports import LOOPBACK, free_port
from mecazen.config import Process
from mecazen.errors import ConfigError, MecazenError
from mecazen.graph import OBSERVERS
from mecazen.runtime.process import FAILED, ROUTER, run_to_exit

from mecazen_tools.forking import CONTEXT, STOPPING, start_server, starting

STOP_TIMEOUT_S = 5.0
"""Time for a process to end before it is killed [s]."""

STEADY_S = 1.0
"""Time of work below which an ended process has failed, so that its restart waits [s]."""
FIRST_PAUSE_S, MAX_PAUSE_S = 0.5, 8.0
"""Pauses before repeated restarts [s]: the first, which doubles each time, and the longest."""

SERVER_ENDED = 255
"""Exit code that `multiprocessing` reports for all processes if the fork server has ended."""
EVENT = re.compile(r"t=\S+ level=info service=\S+ msg=(\S+)(?: url=(\S+))?")
"""A line of a service's log that is no warning: an event, and the address of a page."""


class Line(NamedTuple):
    """A line for the user: the log of a process, or its change of state."""

    name: str
    text: str
    is_address: bool = False
    """Whether it is the address of a page that the process serves."""


@dataclass(eq=False)
class _Part:
    """A process that was forked, and the data for its restart."""

    process: Process
    """Its services and robot."""
    needed: bool
    child: ForkServerProcess = field(init=False)
    pid: int = field(init=False)
    log: FileIO = field(init=False)
    """Its standard error, not blocking."""
    begun: bytes = b""
    """Begin of a line of the log."""
    last_line: str = ""
    error: str = ""
    """The error with which it ends."""
    has_run: bool = False
    """Whether the process has ever logged that it works."""
    begin_s: float = math.inf
    """Begin of the process's present work [s]; infinite while it does not work."""
    failures: int = 0
    """Number of consecutive ends before `STEADY_S` of work."""
    restart_s: float = math.inf
    """Time of its restart [s]; infinite if it is not started again."""


class Supervisor:
    """The processes of one scenario.

    All are forked from one server (see `forking`), each into its own session. So Ctrl-C reaches
    only this process, which then ends the others. If this process dies, the others end as well.

    With `restart` a process that has ended is started again, at once, or after a pause that grows
    while it keeps ending. A process that fails before it has ever run, or because of its scenario,
    is still an error.

    Args:
        path: The scenario's file.
        settings: Its overrides.
        restart: See above.
    """

    def __init__(self, path: Path, settings: Sequence[str], *, restart: bool = False) -> None:
        self._path, self._settings = str(path), tuple(settings)
        self._restart = restart
        self._parts: dict[str, _Part] = {}
        self._sources = DefaultSelector()
        """Logs of running processes, and what becomes readable at their ends."""
        self._ended: deque[_Part] = deque()
        self._lines: deque[Line] = deque()
        start_server()

    @property
    def pids(self) -> dict[str, int]:
        """The process of each name that was started."""
        return {name: part.pid for name, part in self._parts.items()}

    def works(self, name: str) -> bool:
        """Return whether a process had logged by the last `poll` that it works."""
        return self._parts[name].begin_s < math.inf

    def start(self, process: Process, *, needed: bool = True) -> None:
        """Start a process; the service `router` is the router.

        If it is not `needed`, its end is no error.

        Raises:
            MecazenError: The fork server has ended.
        """
        part = self._parts[process.name] = _Part(process, needed)
        self._fork(part)

    def _fork(self, part: _Part) -> None:
        out, into = os.pipe()
        os.set_blocking(out, False)
        with Connection(into, readable=False) as log, starting():
            arguments = (part.process, self._path, self._settings, log)
            part.child = CONTEXT.Process(target=_run, args=arguments, daemon=True)
            try:
                part.child.start()
            except (ConnectionError, EOFError):
                os.close(out)
                raise MecazenError(f"{part.process.name}: the fork server has ended") from None
        assert part.child.pid is not None  # as for every process that has begun
        part.pid, part.log = part.child.pid, FileIO(out)
        for source in (part.log, part.child.sentinel):
            self._sources.register(source, EVENT_READ, part)

    def start_router(self, timeout_s: float = 10.0) -> None:
        """Start the router and wait until it listens.

        Raises:
            MecazenError: It ended, most often because the port is taken, or it logs nothing.
        """
        self.start(ROUTER)
        deadline = time.monotonic() + timeout_s
        while not self.works(ROUTER.name):
            left_s = deadline - time.monotonic()
            if left_s <= 0.0:
                raise MecazenError("the router does not start")
            self.poll(left_s)

    def poll(self, timeout_s: float) -> Line | None:
        """Return the next line that a process wrote, or None if none is written in time.

        Raises:
            MecazenError: A process that is needed has ended, and is not started again.
        """
        end_s = time.monotonic() + timeout_s
        while not self._lines and not self._ended:
            wait_s = min(end_s, self._start_again()) - time.monotonic()
            if not self._read(max(wait_s, 0.0)) and time.monotonic() >= end_s:
                return None
        return self._lines.popleft() if self._lines else self._take_end(self._ended.popleft())

    def _read(self, timeout_s: float | None) -> bool:
        """Wait until a process writes or ends; return whether one has done so in time."""
        ready = self._sources.select(timeout_s)
        for part in dict.fromkeys(key.data for key, _ in ready):
            has_ended = part.child.exitcode is not None
            data = part.begun + (part.log.readall() or b"")
            *lines, part.begun = (data + b"\n" * has_ended).split(b"\n")
            for line in filter(None, lines):
                self._take_line(part, line.decode(errors="replace").rstrip())
            if has_ended:
                self._sources.unregister(part.log)
                self._sources.unregister(part.child.sentinel)
                part.log.close()
                self._ended.append(part)
            if part.child.exitcode == SERVER_ENDED:
                with suppress(ProcessLookupError):
                    os.kill(part.pid, signal.SIGKILL)
        return bool(ready)

    def _take_line(self, part: _Part, text: str) -> None:
        name = part.process.name
        event = EVENT.match(text)
        if text.startswith(FAILED):
            part.error = text.removeprefix(FAILED)
        elif event is None:
            part.last_line = text
            self._lines.append(Line(name, text))
        elif event[1] == "started":
            part.has_run, part.begin_s = True, time.monotonic()
            if name == ROUTER.name:
                self._lines.append(Line(name, "the router listens"))
        elif event[1] == "serving":
            self._lines.append(Line(name, event[2], is_address=True))

    def _start_again(self) -> float:
        """Restart the processes that are due; return the monotonic time of the next restart [s]."""
        for part in self._parts.values():
            if part.restart_s <= time.monotonic():
                part.begun, part.restart_s = b"", math.inf
                part.last_line = part.error = ""
                self._fork(part)
        return min((part.restart_s for part in self._parts.values()), default=math.inf)

    def _take_end(self, part: _Part) -> Line:
        name, code = part.process.name, part.child.exitcode or 0
        worked_s, part.begin_s = time.monotonic() - part.begin_s, math.inf
        # the error of a node begins with its name
        how = _how(code, part.error or part.last_line).removeprefix(f"{name}: ")
        # an observer that reported an error, such as a full disk, would report the error again
        hopeless = not part.has_run or (not part.needed and part.error != "")
        is_wrong = code == ConfigError.exit_code  # by the scenario, which stays the same
        if not self._restart or is_wrong or (0 < code != SERVER_ENDED and hopeless):
            if part.needed:
                raise MecazenError(f"{name}: {how}")
            return Line(name, f"{name} has ended: {how}; the others go on")
        part.failures = 0 if worked_s >= STEADY_S else part.failures + 1
        # the system may not have removed a fork server yet that has just ended
        pause_s = FIRST_PAUSE_S if code == SERVER_ENDED else 0.0
        if part.failures > 1:
            pause_s = min(FIRST_PAUSE_S * 2 ** (part.failures - 2), MAX_PAUSE_S)
        part.restart_s = time.monotonic() + pause_s
        when = f"in {pause_s:g} s" if pause_s else "at once"
        return Line(name, f"{name}: {how}; it is started again {when}")

    def stop(self) -> list[str]:
        """End all processes; return the names of those that had to be killed.

        Observers end after all others, so that they receive all samples.
        """
        last = {ROUTER.name, *OBSERVERS}
        return [*self._stop(self._parts.keys() - last), *self._stop(last)]

    def refuse_failed(self) -> None:
        """Raise MecazenError if a needed process that has ended since the last `poll` failed."""
        for part in self._ended:
            if part.needed and part.error:
                self._take_end(part)

    def _stop(self, names: Collection[str]) -> list[str]:
        def running() -> list[_Part]:
            parts = dict.fromkeys(key.data for key in self._sources.get_map().values())
            return [part for part in parts if part.process.name in names]

        for part in running():
            part.child.terminate()
        end_s = time.monotonic() + STOP_TIMEOUT_S
        while running() and (left_s := end_s - time.monotonic()) > 0.0:
            self._read(left_s)
        killed = running()
        for part in killed:
            part.child.kill()
        while running():
            self._read(None)
        return sorted(part.process.name for part in killed)


def _run(process: Process, path: str, settings: tuple[str, ...], log: Connection) -> None:
    """Run a process in a fork, with its standard error to `log`, until its supervisor ends."""
    gc.freeze()  # a collection would write to all shared memory
    os.setsid()
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPPING)
    os.dup2(log.fileno(), 2)
    log.close()
    Path("/proc/self/comm").write_text(process.name, encoding="utf-8")
    threading.Thread(target=_end_with_supervisor, daemon=True).start()
    run_to_exit(process, path, settings)


def _end_with_supervisor() -> None:
    supervisor = parent_process()
    assert supervisor is not None
    supervisor.join()
    os.kill(os.getpid(), signal.SIGTERM)


def _how(code: int, last_line: str) -> str:
    """Return in one line how a process has ended."""
    if code == SERVER_ENDED:
        return "has ended with the fork server"
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return last_line or f"ended with code {code}"


def private_router(protocol: Literal["tcp", "tls"] = "tcp") -> tuple[str, ...]:
    """Return settings for a router at a free port and a namespace of its own.

    So several runs, also one of `mecazen up`, do not receive each other's samples.
    """
    return (
        f'bus.connect=["{protocol}/{LOOPBACK}:{free_port()}"]',
        f"bus.namespace=run{secrets.token_hex(4)}",
    )
