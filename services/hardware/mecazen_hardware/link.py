"""The link to a board: its port, threads that read and write, and the keeper of the motors.

`read` and `drive` never wait. One thread collects the reports with their times of arrival. Another
thread writes a frame that came too soon after the last one.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, TypeVar

from mecazen.wheels import WheelSpeeds

from mecazen_hardware import keeper
from mecazen_hardware.board import Board, Identity, Report
from mecazen_hardware.errors import HardwareError

SILENCE_S = 0.3
"""Time without a frame of the driver after which the keeper stops the motors [s]."""
ANSWER_S = 2.0
"""Maximum time until a board has answered and sent each kind of report [s]."""
ASK_AGAIN_S = 0.3
"""Time between two greetings: real boards leave some unanswered [s]."""
POLL_S = 0.05
"""Time for which the thread waits for bytes before it checks whether to end [s]."""

ReportT = TypeVar("ReportT", bound=Report)


class Bytes(Protocol):
    """The methods of a port that a link calls."""

    name: str

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived within a time."""

    def write(self, frame: bytes) -> bool:
        """Send a frame; return whether there was room for it."""

    def close(self) -> None:
        """Close the port."""


class Link:
    """The connection to a board: receives reports, sends frames, and stops the motors at the end.

    Args:
        board: The protocol.
        port: The open port, which the link closes.
        fd: The port's file descriptor for the keeper; None for a port without real motors.

    Raises:
        HardwareError: The board does not answer, or is of another kind.
    """

    def __init__(self, board: Board, port: Bytes, fd: int | None) -> None:
        self.board, self.port = board, port
        self.sent = self.unsent = 0
        """Numbers of frames that were written, and that did not fit into the output buffer."""
        self._written_s = 0.0
        self._failure: HardwareError | None = None
        self._output = threading.Condition()
        """Lock of the port's output."""
        self._waiting: dict[bool, tuple[bytes, bytes]] = {}
        """Frames that came too soon, each with its heartbeat byte for the keeper.

        The newest request for reports is at False, the newest frame for the motors at True."""
        self._news = threading.Condition()
        self._reports: list[tuple[Report, float]] = []
        self._newest: dict[type[Report], tuple[Report, float]] = {}
        self._closing = False
        self._keeper: subprocess.Popen[bytes] | None = None
        self._heartbeat: int | None = None
        self._threads = [
            threading.Thread(target=run, name="board", daemon=True)
            for run in (self._read, self._write_late)
        ]
        for thread in self._threads:
            thread.start()
        try:
            if fd is not None:
                self._keep(fd)
            self.identity = self._greet()
        except BaseException:
            self.close()
            raise

    def read(self) -> list[tuple[Report, float]]:
        """Return the reports since the last call, each with its arrival on the monotonic clock [s].

        Raises:
            HardwareError: The port has gone.
        """
        self._refuse_failure()
        with self._news:
            reports, self._reports = self._reports, []
        return reports

    def newest(self, kind: type[ReportT]) -> ReportT | None:
        """Return the newest report of a kind."""
        found = self._newest.get(kind)  # type: ignore[arg-type]  # a kind of report
        return None if found is None else found[0]  # type: ignore[return-value]  # by its key

    def drive(self, speeds: WheelSpeeds) -> WheelSpeeds:
        """Send wheel speeds [rad/s]; return the speeds that the board will drive.

        A frame that follows the last one too soon waits; a newer frame replaces a waiting frame.

        Raises:
            HardwareError: The port has gone.
            ValueError: A speed is not finite.
        """
        frame, sent = self.board.drive(speeds)
        sign = keeper.DRIVE if any(sent) else keeper.STOP
        self._refuse_failure()
        self._post(frame, sign)
        return sent

    def stop(self) -> None:
        """Stop all motors, which takes some milliseconds.

        Raises:
            HardwareError: The port has gone.
        """
        for frame in self.board.stop():
            self.ask(frame)

    def ask(self, frame: bytes, sign: bytes = keeper.STOP) -> None:
        """Send a frame for the motors as soon as the board can take one; it replaces a waiting one.

        Raises:
            HardwareError: The port has gone.
        """
        self._refuse_failure()
        self._send(frame, sign)

    def poll(self) -> None:
        """Request the next reports, if the board does not send them by itself.

        Raises:
            HardwareError: The port has gone.
        """
        self._refuse_failure()
        if frame := self.board.poll():
            self._post(frame)

    def close(self) -> None:
        """Stop the motors, even after a failure, and close the port."""
        if self._closing:
            return
        try:
            for frame in self.board.stop():
                self._send(frame, keeper.STOP)
        except HardwareError:
            pass  # the port has gone; the original error matters more
        finally:
            with self._output:
                self._closing = True
                self._output.notify_all()
            if self._heartbeat is not None:
                os.close(self._heartbeat)  # the keeper stops the motors once more, and ends
            if self._keeper is not None:
                self._keeper.wait()
            for thread in self._threads:
                thread.join()
            self.port.close()

    @property
    def _wait_s(self) -> float:
        """Time until the board can take a frame [s]."""
        return self._written_s + self.board.SPACING_S - time.monotonic()

    def _post(self, frame: bytes, sign: bytes = b"") -> None:
        """Write a frame, or let it wait for those before it and until the board can take it."""
        with self._output:
            if self._waiting or self._wait_s > 0.0:
                self._waiting[bool(sign)] = frame, sign
                self._output.notify_all()
            else:
                self._write(frame, sign)

    def _send(self, frame: bytes, sign: bytes) -> None:
        """Write a frame as soon as the board can take one; it replaces a waiting frame."""
        with self._output:
            time.sleep(max(self._wait_s, 0.0))
            self._write(frame, sign)

    def _write(self, frame: bytes, sign: bytes = b"") -> None:
        """Write a frame, and notify the keeper; the caller holds the lock of the output.

        Without a keeper only frames that stop the motors are written.
        """
        self._waiting.pop(bool(sign), None)
        if self._heartbeat is not None and sign:
            try:
                os.write(self._heartbeat, sign)
            except BrokenPipeError:
                if sign != keeper.STOP:
                    raise HardwareError(
                        f"{self.port.name}: the process that stops the motors in an emergency was "
                        "killed; start again"
                    ) from None
        if self.port.write(frame):
            self.sent += 1
        else:
            self.unsent += 1
        self._written_s = time.monotonic()  # the time after the write keeps the gap

    def _write_late(self) -> None:
        """Write each waiting frame once the board can take it, the oldest kind first."""
        with self._output:
            while not self._closing:
                if not self._waiting:
                    self._output.wait()
                elif (wait_s := self._wait_s) > 0.0:
                    self._output.wait(wait_s)
                else:
                    try:
                        self._write(*next(iter(self._waiting.values())))
                    except HardwareError as failure:
                        self._failure = failure
                        return

    def _refuse_failure(self) -> None:
        if self._failure is not None:
            raise self._failure

    def _read(self) -> None:
        while not self._closing:
            try:
                data = self.port.read(POLL_S)
            except HardwareError as failure:
                with self._news:
                    self._failure = failure
                    self._news.notify_all()
                return
            now_s = time.monotonic()
            if not data or not (reports := self.board.feed(data)):
                continue
            with self._news:
                for report in reports:
                    self._newest[type(report)] = report, now_s
                self._reports += [(report, now_s) for report in reports]
                del self._reports[:-1000]  # a paused run does not read them
                self._news.notify_all()

    def _keep(self, fd: int) -> None:
        """Start the process that stops the motors if this process can't."""
        out, self._heartbeat = os.pipe()
        os.set_blocking(self._heartbeat, False)
        frames = [frame.hex() for frame in self.board.stop()]
        spacing_s = max(2 * self.board.SPACING_S, 0.001)
        try:
            self._keeper = subprocess.Popen(
                [
                    *(sys.executable, "-I", "-S", str(Path(keeper.__file__))),
                    *(str(fd), str(out), str(SILENCE_S), str(spacing_s), *frames),
                ],
                pass_fds=(fd, out),
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C in a terminal must not stop the keeper
            )
        finally:
            os.close(out)

    def _greet(self) -> Identity:
        """Request the board's identity, and wait for each kind of report.

        Raises:
            HardwareError: The board does not answer in time, or is of another kind.
        """
        until_s = time.monotonic() + ANSWER_S
        asked_s = -float("inf")
        wanted: set[type[Report]] = {Identity, *self.board.KINDS}
        while missing := wanted - self._newest.keys():
            self._refuse_failure()
            now_s = time.monotonic()
            if now_s > until_s:
                raise HardwareError(f"{self.port.name}: {self._silence(missing)}")
            if now_s - asked_s > ASK_AGAIN_S:
                self._ask_all(self.board.hello())
                asked_s = now_s
            self.poll()
            with self._news:
                self._news.wait(POLL_S)
        identity = self.newest(Identity)
        assert identity is not None  # the loop has waited for it
        if identity.problem:
            raise HardwareError(f"{self.port.name}: {identity.name}: {identity.problem}")
        return identity

    def _ask_all(self, frames: Sequence[bytes]) -> None:
        for frame in frames:
            self.ask(frame)

    def _silence(self, missing: set[type[Report]]) -> str:
        board, name = self.board, self.board.config.board
        if not board.frames and not board.refused:
            return f"nothing answers: is the {name} switched on, and is this its port?"
        if not board.frames:
            return f"what answers is not a {name}: no frame of its protocol in what it sends"
        kinds = ", ".join(sorted(kind.__name__ for kind in missing))
        return f"the {name} answers, but does not send {kinds}; switch it off and on"
