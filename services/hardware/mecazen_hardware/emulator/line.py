"""The emulated board in real time: a serial line that ends in a pseudo-terminal, and its clock."""

from __future__ import annotations

import errno
import os
import pty
import select
import termios
import threading
import time
import tty
from collections import deque
from contextlib import suppress
from pathlib import Path

from mecazen.errors import MecazenError

from mecazen_hardware.emulator.firmware import Firmware
from mecazen_hardware.emulator.world import TICK_MS, EmulatedWorld

BYTES_PER_MS = 11
"""115200 baud, 8N1: ten bits for a byte, so 11.52, rounded down."""
GAP_S = 0.002
"""Minimum time between two frames so that the board receives both [s]."""
PRIORITY = 2
"""Real-time priority, above the driver's: a real board has a processor of its own."""


class SerialLine:
    """The board's end of a line; `name` and a symbolic link are the host's end.

    Raises:
        MecazenError: The path of the link exists already.
    """

    def __init__(self, link: Path | None = None) -> None:
        self.fd, self._slave = pty.openpty()
        tty.setraw(self._slave)  # otherwise the terminal echoes the board's bytes
        os.set_blocking(self.fd, False)
        self.name = os.ttyname(self._slave)
        self._out = b""
        self._link = link
        if link is None:
            return
        if link.is_symlink() and not link.exists():
            link.unlink()  # left by an emulator that was killed
        try:
            link.symlink_to(self.name)
        except OSError as error:
            exists = "taken: stop the other emulator, or remove the file"
            reason = exists if error.errno == errno.EEXIST else error.strerror
            raise MecazenError(f"--link {link}: {reason}") from None

    def read(self) -> bytes:
        """Return what the host has sent."""
        try:
            return os.read(self.fd, 4096)
        except BlockingIOError:
            return b""

    def millisecond(self, data: bytes) -> None:
        """Queue bytes for the host, and transmit what the line carries in a millisecond."""
        self._out += data
        carried, self._out = self._out[:BYTES_PER_MS], self._out[BYTES_PER_MS:]
        try:
            os.write(self.fd, carried)
        except BlockingIOError:
            termios.tcflush(self._slave, termios.TCIFLUSH)  # no one reads: discard the old bytes

    def close(self) -> None:
        """Remove the port, as if its cable were pulled."""
        os.close(self.fd)
        os.close(self._slave)
        if self._link is not None:
            self._link.unlink(missing_ok=True)


class Emulator:
    """An emulated ROSMASTER X3: passes bytes and time to the firmware, and duties to the world."""

    def __init__(self, line: SerialLine, world: EmulatedWorld, firmware: Firmware) -> None:
        self.line, self.world, self.firmware = line, world, firmware
        self._ms = 0
        self._incoming: deque[tuple[int, bool]] = deque()
        """Bytes from the host, each with whether there was a gap before it."""
        self._looked_s = self._earliest_s = time.monotonic()

    def run(self, stopped: threading.Event) -> None:
        """Run in real time until an event."""
        with suppress(PermissionError):  # as for the other processes of a stack
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
        begin_s = time.monotonic()
        while not stopped.is_set():
            due_ms = int(1000.0 * (time.monotonic() - begin_s))
            while self._ms < due_ms:
                self.receive()
                self.millisecond()
            wait_s = begin_s + (self._ms + 1) / 1000.0 - time.monotonic()
            select.select([self.line.fd], [], [], max(wait_s, 0.0))
            self.receive()

    def receive(self) -> None:
        """Take the bytes that the host has sent since the last call.

        A pseudo-terminal has no times of arrival: bytes came at any time since the last call. The
        emulator assumes a gap between two frames if their possible times allow it.
        """
        now_s, last_s = time.monotonic(), self._looked_s
        self._looked_s = now_s
        if data := self.line.read():
            before, within = now_s - self._earliest_s >= GAP_S, now_s - last_s >= GAP_S
            self._incoming.extend((byte, within if n else before) for n, byte in enumerate(data))
            self._earliest_s = last_s

    def millisecond(self) -> None:
        """Advance line, firmware and world by a millisecond."""
        for _ in range(min(BYTES_PER_MS, len(self._incoming))):
            byte, had_gap = self._incoming[0]
            if self.firmware.frame and had_gap:
                break
            self._incoming.popleft()
            self.firmware.receive(byte)
        self.line.millisecond(self.firmware.millisecond(self.world.measured))
        self._ms += 1
        if self._ms % TICK_MS == 0:
            self.world.step(self.firmware.duty)
