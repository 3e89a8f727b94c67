"""The serial port of a board: reads and writes that never wait, and errors with a remedy."""

from __future__ import annotations

import errno
import os
import termios
import time
from contextlib import suppress
from pathlib import Path

import serial
from mecazen.errors import MecazenError
from serial.tools import list_ports

BUSY_FOR_S = 1.0
"""Maximum wait for the port [s]: after a driver was killed, its keeper holds the port for a
moment."""
BUSY = (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK)


class HardwareError(MecazenError):
    """The port or the board can't be used, or was disconnected."""


class Port:
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
    return f"can't be opened: {error}"


def usb_ports() -> list[str]:
    """Return the devices of connected USB adapters, those of a CH340 first."""
    ports = [port for port in list_ports.comports() if port.vid is not None]
    return [
        port.device for port in sorted(ports, key=lambda port: (port.vid != 0x1A86, port.device))
    ]
