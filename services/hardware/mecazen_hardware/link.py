"""The link to a board: its port, the thread that reads and writes, and the keeper of the motors.

A command passes `Link.drive`, `_post`, `_write_due` and `SerialPort.write`; a report passes
`SerialPort.read`, `_receive` and `Link.read`. No method waits for the port, except `close`. A frame
is written at once if the board can take it. The thread writes the others later, and collects the
reports with their times of arrival.
"""

from __future__ import annotations

import errno
import math
import os
import select
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import serial
from mecazen.config import HardwareConfig
from mecazen.errors import ConfigError, MecazenError
from mecazen.programs import imported
from mecazen.robot import Robot
from mecazen.wheels import WheelSpeeds
from serial.tools import list_ports

from mecazen_hardware import keeper
from mecazen_hardware.board import Board, Identity, Report
from mecazen_hardware.rosmaster_x3 import RosmasterX3

SILENCE_S = 0.3
"""Time without a frame of the driver after which the keeper stops the motors [s]."""
ANSWER_S = 2.0
"""Maximum time until a board has answered and sent each kind of report [s]."""
ASK_AGAIN_S = 0.3
"""Time between two greetings: real boards leave some unanswered [s]."""
KEPT_REPORTS = 1000
"""Maximum number of unread reports: a paused run does not read them."""

BUSY_FOR_S = 1.0
"""Maximum wait for the port [s]: after a driver was killed, its keeper holds the port for a
moment."""
BUSY = (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK)


class HardwareError(MecazenError):
    """The port or the board can't be used, or was disconnected."""


class SerialPort:
    """An open serial port, exclusive to this process.

    Raises:
        HardwareError: The port can't be opened; the message states the reason and the remedy.
    """

    def __init__(self, name: str, baud: int) -> None:
        self.name = name
        self._serial = _open(name, baud)
        self.fd: int = self._serial.fileno()
        os.set_blocking(self.fd, False)

    def read(self) -> bytes:
        """Return the bytes that have arrived; raise HardwareError if the port has gone."""
        try:
            data = os.read(self.fd, 4096)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._gone(f" ({error.strerror})") from None
        if not data:
            raise self._gone()
        return data

    def write(self, frame: bytes) -> bool:
        """Send a frame; return whether there was room for it; raise as `read` does."""
        try:
            return os.write(self.fd, frame) == len(frame)
        except BlockingIOError:
            return False
        except OSError as error:
            raise self._gone(f" ({error.strerror})") from None

    def _gone(self, reason: str = "") -> HardwareError:
        return HardwareError(
            f"{self.name}: the port has gone in mid-run{reason}: unplugged, or without power? The "
            "robot may still be driving: switch it off"
        )

    def close(self) -> None:
        """Close the port."""
        with suppress(OSError):
            self._serial.close()


def _open(name: str, baud: int) -> serial.Serial:
    begin_s = time.monotonic()
    while True:
        try:
            return serial.Serial(name, baud, timeout=0, exclusive=True)
        except (serial.SerialException, OSError) as error:
            number, cause = error.errno, error.__context__
            if isinstance(cause, termios.error):  # pyserial drops its number
                number = cause.args[0]
            if number not in BUSY or time.monotonic() - begin_s >= BUSY_FOR_S:
                raise HardwareError(f"{name}: {_reason(name, number, error)}") from None
            time.sleep(0.05)


def _reason(name: str, number: int | None, error: Exception) -> str:
    if number == errno.ENOENT:
        return f"no such port; ports here: {', '.join(usb_ports()) or 'none'}"
    if number in (errno.EACCES, errno.EPERM):
        group = Path(name).group()
        return (
            f"no permission; `sudo usermod -aG {group} $USER`, and log in again, if the port "
            f"belongs to the group {group}"
        )
    if number in BUSY:
        return "in use by another program: one driver at a time"
    if number == errno.ENOTTY:
        return "not a serial port"
    return f"can't be opened: {os.strerror(number) if number else error}"


def usb_ports() -> list[str]:
    """Return the devices of connected USB adapters, those of a CH340 first."""
    ports = [port for port in list_ports.comports() if port.vid is not None]
    return [
        port.device for port in sorted(ports, key=lambda port: (port.vid != 0x1A86, port.device))
    ]


def make_board(config: HardwareConfig, robot: Robot) -> Board:
    """Return the protocol of the configured board.

    Raises:
        ConfigError: There is no such board.
    """
    if config.board == "rosmaster_x3":
        return RosmasterX3(config, robot)
    kind = imported(config.board) if ":" in config.board else None
    if not (isinstance(kind, type) and issubclass(kind, Board)):
        raise ConfigError(
            f"hardware.board: no board {config.board!r}: rosmaster_x3, or a subclass of "
            "mecazen_hardware.board.Board as file.py:Class"
        )
    return kind(config, robot)


class Link:
    """The connection to a board: receives reports, sends frames, and stops the motors at the end.

    All methods but `close` raise HardwareError once the port or the keeper has gone.

    Raises:
        ConfigError: There is no such board.
        HardwareError: The port can't be opened, or the board does not answer as it should.
    """

    def __init__(self, config: HardwareConfig, robot: Robot) -> None:
        self.board = make_board(config, robot)
        self.port = SerialPort(config.port, self.board.BAUD)
        self.sent = self.unsent = 0
        """Numbers of frames that were written, and that did not fit into the output buffer."""
        self._lock = threading.Condition()
        """Guards the attributes below; notified when reports or a failure have come."""
        self._reports: list[tuple[Report, float]] = []
        self._failure: HardwareError | None = None
        self._frames: list[bytes] = []
        """Frames that wait, of a greeting or to stop the motors."""
        self._motion: tuple[bytes, bytes] | None = None
        """The newest frame for the motors, with its heartbeat byte, if it still waits."""
        self._free_s = 0.0
        """When the board can take the next frame [s]."""
        self._is_closing = False
        self._woken, self._wake = os.pipe()
        self.keeper, self._heartbeat = self._start_keeper()
        """The process that stops the motors if this process can't."""
        self._thread = threading.Thread(target=self._run, name="board", daemon=True)
        self._thread.start()
        try:
            self.identity = self._greet()
        except BaseException:
            self.close()
            raise

    def read(self) -> list[tuple[Report, float]]:
        """Return the new reports, each with its time of arrival on the monotonic clock [s]."""
        with self._lock:
            self._refuse_failure()
            reports, self._reports = self._reports, []
        return reports

    def drive(self, speeds: WheelSpeeds) -> None:
        """Send wheel speeds [rad/s].

        A frame that follows the last one too soon waits; a newer frame replaces it.

        Raises:
            ValueError: A speed is not finite.
        """
        frame, driven = self.board.drive(speeds)
        self._post(motion=(frame, keeper.DRIVE if any(driven) else keeper.STOP))

    def turn_wheel(self, wheel: int, share: float) -> None:
        """Turn one wheel alone, as `Board.turn_wheel` does."""
        self._post(motion=(self.board.turn_wheel(wheel, share), keeper.DRIVE))

    def stop(self) -> None:
        """Stop all motors."""
        self._post(self.board.stop())

    def close(self) -> None:
        """Stop the motors, even after a failure, and close the port."""
        if self._is_closing:
            return
        with self._lock:
            self._motion, self._frames = None, [*self.board.stop()]
            self._is_closing = True
        os.write(self._wake, b"w")
        self._thread.join()
        os.close(self._heartbeat)  # the keeper stops the motors once more, and ends
        self.keeper.wait()
        self.port.close()
        os.close(self._woken)
        os.close(self._wake)

    def _post(
        self, frames: Sequence[bytes] = (), motion: tuple[bytes, bytes] | None = None
    ) -> None:
        """Write frames, now or later; a frame for the motors that still waits is dropped."""
        with self._lock:
            self._refuse_failure()
            self._motion = motion
            self._frames = [*frames] or self._frames
            self._write_due()
            self._refuse_failure()
            if self._frames or self._motion:
                os.write(self._wake, b"w")

    def _refuse_failure(self) -> None:
        if self._failure is not None:
            raise self._failure

    def _run(self) -> None:
        """Read reports and write frames until the link closes or the port has gone."""
        try:
            while not (self._is_closing and not self._frames):
                waits = self._frames or self._motion
                wait_s = max(self._free_s - time.monotonic(), 0.0) if waits else None
                ready, _, _ = select.select([self.port.fd, self._woken], [], [], wait_s)
                if self._woken in ready:
                    os.read(self._woken, 4096)
                if self.port.fd in ready:
                    self._receive()
                with self._lock:
                    self._write_due()
        except HardwareError as failure:
            with self._lock:
                self._failure = failure
                self._lock.notify_all()

    def _receive(self) -> None:
        data, now_s = self.port.read(), time.monotonic()
        reports = [(report, now_s) for report in self.board.feed(data)]
        with self._lock:
            self._reports = [*self._reports, *reports][-KEPT_REPORTS:]
            self._lock.notify_all()

    def _write_due(self) -> None:
        """Write the next frame after its heartbeat byte, if the board can take it.

        Without a keeper only frames that stop the motors are written. The caller holds the lock.
        """
        if time.monotonic() < self._free_s:
            return
        if self._frames:
            frame, beat = self._frames.pop(0), keeper.STOP
        elif self._motion is not None:
            (frame, beat), self._motion = self._motion, None
        else:
            return
        try:
            os.write(self._heartbeat, beat)
        except (BrokenPipeError, BlockingIOError):
            if beat != keeper.STOP:
                killed = "the process that stops the motors in an emergency was killed"
                self._failure = HardwareError(f"{self.port.name}: {killed}; start again")
                return
        if self.port.write(frame):
            self.sent += 1
        else:
            self.unsent += 1
        self._free_s = time.monotonic() + self.board.SPACING_S

    def _start_keeper(self) -> tuple[subprocess.Popen[bytes], int]:
        """Start the keeper; return its process and the pipe for the heartbeat."""
        received, heartbeat = os.pipe()
        os.set_blocking(heartbeat, False)
        numbers = (self.port.fd, received, SILENCE_S, 2 * self.board.SPACING_S)
        process = subprocess.Popen(
            [
                *(sys.executable, "-I", "-S", str(Path(keeper.__file__)), *map(str, numbers)),
                *(frame.hex() for frame in self.board.stop()),
            ],
            pass_fds=(self.port.fd, received),
            stdin=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C in a terminal must not stop the keeper
        )
        os.close(received)
        return process, heartbeat

    def _greet(self) -> Identity:
        """Request the board's identity, and wait for each kind of report."""
        until_s, asked_s = time.monotonic() + ANSWER_S, -math.inf
        while True:
            with self._lock:
                self._refuse_failure()
                newest = {type(report): report for report, _ in self._reports}
            missing = {Identity, *self.board.KINDS} - newest.keys()
            if not missing:
                break
            now_s = time.monotonic()
            if now_s > until_s:
                raise HardwareError(f"{self.port.name}: {self._silence(missing)}")
            if now_s - asked_s > ASK_AGAIN_S:
                self._post(self.board.hello())
                asked_s = now_s
            with self._lock:
                self._lock.wait(ASK_AGAIN_S)
        identity = newest[Identity]
        assert isinstance(identity, Identity)
        if identity.problem:
            raise HardwareError(f"{self.port.name}: {identity.name}: {identity.problem}")
        return identity

    def _silence(self, missing: set[type[Report]]) -> str:
        board, name = self.board, self.board.config.board
        if not board.frames and not board.refused:
            return f"nothing answers: is the {name} switched on, and is this its port?"
        if not board.frames:
            return f"what answers is not a {name}: no frame of its protocol in what it sends"
        kinds = ", ".join(sorted(kind.__name__ for kind in missing))
        return f"the {name} sends no {kinds}: is its battery low? Charge it; switch it off and on"
