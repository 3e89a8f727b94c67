"""Processes that are forked from one parent.

The parent has imported the code of its forks, and has opened nothing. Forks begin at once and share
its memory. They have the same code at the same addresses, on which a processor bases its
predictions. The parent has a single thread, since a lock held by another thread would stay locked
in a fork. It imports only services of the table, and no observer. All other code, such as a user
node, is imported after the fork.
"""

from __future__ import annotations

import atexit
import gc
import os
import selectors
import signal
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

import msgspec
from mecazen import graph
from mecazen.config import Process, Scenario
from mecazen.errors import MecazenError
from mecazen.extras import is_installed
from mecazen.loading import load_scenario, parse_settings
from mecazen.programs import find
from mecazen.runtime import __main__ as runtime
from mecazen.runtime.process import end_with_stdin
from mecazen.runtime.report import Report, Reporter

MAX_REQUEST_BYTES = 1 << 17
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Start(msgspec.Struct, frozen=True, tag=True):
    """Request to fork a process, sent with its ends of two pipes: standard error and reports."""

    process: Process
    cores: tuple[int, ...]
    policy: int
    """The scheduling policy; `priority` belongs to it."""
    priority: int


class Signal(msgspec.Struct, frozen=True, tag=True):
    """Request to send a signal to a process, unless it has ended."""

    pid: int
    number: int


class Child:
    """A process that was forked.

    Args:
        pid: Id of the process.
        reports: Pipe with its reports, and with the parent's report of its end.
        errors: Pipe with its standard error.
    """

    def __init__(self, pid: int, reports: int, errors: int) -> None:
        self.pid = pid
        self.reports = open(reports, "rb")  # noqa: SIM115  # until it ends
        self.errors = open(errors, encoding="utf-8", errors="replace")  # noqa: SIM115
        self.code: int | None = None
        """Its exit code after its end, if the parent has reported it."""
        self.ended = threading.Event()

    def next_report(self) -> Report | None:
        """Wait for the next report of the process; return None if the process has ended."""
        line = self.reports.readline()
        report = msgspec.json.decode(line, type=Report) if line else None
        if report is not None and report.kind == "ended":
            self.code = report.number
        if report is None or report.kind == "ended":
            self.reports.close()
            self.ended.set()
            return None
        return report


class Parent:
    """A client of the parent. The parent and its forks end with the process that holds this object.

    The parent is forked from this process, if it has a single thread, and shares its imports.

    Args:
        path: The scenario's file.
        settings: Its overrides.
        scenario: The scenario loaded from both, so that no fork has to load it; None if loading it
            has imported user nodes.
    """

    def __init__(self, path: Path, settings: Sequence[str], scenario: Scenario | None) -> None:
        self._requests, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            if scenario is None or _threads() > 1:
                command = [sys.executable, "-m", "mecazen_tools.forking", str(path), *settings]
                stdin = (os.POSIX_SPAWN_DUP2, theirs.fileno(), 0)
                self._pid = os.posix_spawn(command[0], command, os.environ, file_actions=[stdin])
            else:
                sys.stdout.flush()  # else a fork would write the output again
                gc.freeze()  # a collection would write to all shared memory
                signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)  # until the fork has handlers
                self._pid = os.fork()
                if not self._pid:
                    self._requests.close()
                    os.dup2(theirs.fileno(), 0)
                    _end_after(lambda: serve(lambda: scenario, scenario.services))
                signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPPING)
        self._ended = False

    def start(self, process: Process) -> Child | None:
        """Fork a process with the cores and the scheduling of the calling thread.

        Returns:
            The process; None if the parent has ended.

        Raises:
            MecazenError: The parent can't fork.
        """
        (reports, report_end), (errors, error_end) = os.pipe(), os.pipe()
        request = Start(
            process,
            tuple(os.sched_getaffinity(0)),
            os.sched_getscheduler(0),
            os.sched_getparam(0).sched_priority,
        )
        self._ask(request, error_end, report_end)
        os.close(error_end)
        os.close(report_end)
        answer = b""
        with suppress(ConnectionResetError):
            answer = self._requests.recv(MAX_REQUEST_BYTES)
        answered = msgspec.json.decode(answer, type=Report) if answer else None
        if answered is not None and answered.kind == "forked":
            return Child(answered.number, reports, errors)
        os.close(reports)
        os.close(errors)
        if answered is not None:
            raise MecazenError(answered.text)
        return None

    def signal(self, pid: int, number: int) -> None:
        """Send a fork a signal, unless it has ended: its id may then be another process's."""
        self._ask(Signal(pid, number))

    def _ask(self, request: Start | Signal, *descriptors: int) -> None:
        with suppress(BrokenPipeError, ConnectionResetError):  # the pipes report its end
            socket.send_fds(self._requests, [msgspec.json.encode(request)], descriptors)

    def close(self) -> None:
        """End the parent."""
        self._requests.close()
        if not self._ended:
            os.waitpid(self._pid, 0)
            self._ended = True


class _Forks:
    """The processes that were forked.

    Args:
        requests: Socket with requests.
        services: Services of later requests, which are imported while no request waits.
    """

    def __init__(self, requests: socket.socket, services: Sequence[str]) -> None:
        self._requests = requests
        self._to_import = deque(services)
        self._ready = selectors.DefaultSelector()
        self._ready.register(requests, selectors.EVENT_READ)
        self._running: dict[int, tuple[int, int]] = {}
        """Process id, and pipe for the report of its end, by a descriptor that is readable after
        the end."""

    def serve(self) -> tuple[Start, int, int] | None:
        """Fork on request until the socket closes; then return None.

        In each fork, return the request, and the pipes for standard error and for reports.
        """
        while True:
            ready = self._ready.select(0.0 if self._running and self._to_import else None)
            if not ready:
                _import([self._to_import.popleft()])
            for key, _ in ready:
                if key.fd in self._running:
                    self._report_end(key.fd)
                    continue
                data = b""
                with suppress(ConnectionResetError):  # closed with an answer unread
                    data, ends, _, _ = socket.recv_fds(self._requests, MAX_REQUEST_BYTES, 2)
                if not data:
                    return None
                request = msgspec.json.decode(data, type=Start | Signal)
                if isinstance(request, Start):
                    errors, reports = ends
                    if self._fork(request, errors, reports):
                        return request, errors, reports
                elif any(pid == request.pid for pid, _ in self._running.values()):
                    os.kill(request.pid, request.number)

    def _fork(self, start: Start, errors: int, reports: int) -> bool:
        """Fork, and return whether this is the new process."""
        _import(start.process.services)
        threads = _threads()
        if threads == 1:
            gc.freeze()
            pid = os.fork()
            if not pid:
                self._leave()
                return True
            ended = os.pidfd_open(pid)
            self._running[ended] = pid, reports
            self._ready.register(ended, selectors.EVENT_READ)
            answer = Report("forked", number=pid)
        else:
            answer = Report("failed", f"a process of {threads} threads can't be forked")
            os.close(reports)
        os.close(errors)
        with suppress(BrokenPipeError):  # the end of the socket comes next
            self._requests.send(msgspec.json.encode(answer))
        return False

    def _report_end(self, ended: int) -> None:
        pid, reports = self._running.pop(ended)
        code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        Reporter(reports).tell(Report("ended", number=code))
        self._ready.unregister(ended)
        os.close(ended)
        os.close(reports)

    def _leave(self) -> None:
        """Close in a fork the descriptors of its parent."""
        self._ready.close()
        self._requests.close()
        for ended, (_, reports) in self._running.items():
            os.close(ended)
            os.close(reports)


def _threads() -> int:
    """Return the number of threads of this process, Python's and others."""
    return len(list(Path("/proc/self/task").iterdir()))


def _end_after(work: Callable[[], None]) -> NoReturn:
    """Run the work, then end this process without a return to the code before the fork."""
    code = 0
    try:
        work()
    except SystemExit as ended:
        code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException:
        sys.excepthook(*sys.exc_info())
        code = 1
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _import(wanted: Sequence[str]) -> None:
    """Import the nodes of services; a fork that needs a node reports its failed import."""
    table = graph.services(graph.GRAPH)
    for row in (row for name in wanted if is_installed(name) for row in table.get(name, ())):
        if row.program and not row.observes:
            with suppress(Exception):
                find(row.name, {})


def serve(load: Callable[[], Scenario], services: Sequence[str] = ()) -> None:
    """Fork on requests from standard input, a socket, until it closes; run the service in the fork.

    Args:
        load: Function that returns the scenario; called in each fork.
        services: Services that will probably be requested.
    """
    # else NumPy starts threads when it is imported; its products here are too small for them
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    os.setsid()
    for number in STOPPING:
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPPING)
    gc.disable()
    # forks end with their standard input; only this process holds the other end
    alive, living = os.pipe()
    forked = _Forks(socket.socket(fileno=0), services).serve()
    if forked is None:
        return
    start, errors, reports = forked
    reporter = Reporter(reports)
    os.close(living)
    os.dup2(alive, 0)
    os.dup2(errors, 2)
    os.close(alive)
    os.close(errors)
    os.setsid()
    Path("/proc/self/comm").write_text(start.process.name, encoding="utf-8")
    os.sched_setaffinity(0, start.cores)
    os.sched_setscheduler(0, start.policy, os.sched_param(start.priority))
    gc.enable()
    end_with_stdin()
    with runtime.ending_in_one_line(reporter):
        runtime.run("+".join(start.process.services), load(), start.process.robot, reporter)


if __name__ == "__main__":
    serve(lambda: load_scenario(Path(sys.argv[1]), parse_settings(sys.argv[2:])))
