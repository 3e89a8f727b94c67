"""A serial line that ends in a pseudo-terminal, with the transmission time of a real line."""

from __future__ import annotations

import errno
import os
import pty
import termios
import tty
from collections import deque
from contextlib import suppress
from pathlib import Path

from mecazen.errors import MecazenError

BYTES_PER_MS = 11.52
"""115200 baud, 8N1: ten bits for a byte."""


class Line:
    """The board's end of a line; `name` is the host's end, for `serial.Serial`.

    Args:
        link: Path of a symbolic link to the host's end, whose device name is not known in advance.

    Raises:
        MecazenError: The path of the link exists already.
    """

    def __init__(self, link: Path | None = None) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)  # otherwise the terminal echoes the board's bytes
        os.set_blocking(self._master, False)
        self.name = os.ttyname(self._slave)
        self._link = link
        if link is not None:
            self._place(link)
        self._out: deque[int] = deque()
        self._room = 0.0
        self.is_open = True

    @property
    def fd(self) -> int:
        """The file descriptor that becomes readable when the host has sent something."""
        return self._master

    def read(self) -> bytes:
        """Return what the host has sent."""
        try:
            return os.read(self._master, 4096)
        except BlockingIOError:
            return b""

    def send(self, data: bytes) -> None:
        """Queue bytes for the host, after those that are still on the line."""
        self._out.extend(data)

    @property
    def waiting(self) -> int:
        """Number of bytes that are still on the line."""
        return len(self._out)

    def millisecond(self) -> None:
        """Transmit the bytes that the line carries in a millisecond."""
        self._room = min(self._room + BYTES_PER_MS, 2 * BYTES_PER_MS)
        count = min(int(self._room), len(self._out))
        if not count:
            return
        self._room -= count
        data = bytes(self._out.popleft() for _ in range(count))
        try:
            os.write(self._master, data)
        except BlockingIOError:
            termios.tcflush(self._slave, termios.TCIFLUSH)  # no one reads: discard the old bytes

    def unplug(self) -> None:
        """Remove the port, as if its cable were pulled."""
        self.is_open = False
        os.close(self._master)
        os.close(self._slave)
        self._unlink()

    def close(self) -> None:
        """Remove the port."""
        if self.is_open:
            self.unplug()

    def _place(self, link: Path) -> None:
        if link.is_symlink() and not link.exists():
            link.unlink()  # left by an emulator that was killed
        try:
            link.symlink_to(self.name)
        except OSError as error:
            os.close(self._master)
            os.close(self._slave)
            why = "taken" if error.errno == errno.EEXIST else error.strerror
            raise MecazenError(f"--link {link}: {why}; another emulator may have it") from None

    def _unlink(self) -> None:
        if self._link is not None:
            with suppress(FileNotFoundError):
                self._link.unlink()
