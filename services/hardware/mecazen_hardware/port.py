"""The port of a board: non-blocking reads and writes, and error messages with a remedy."""

from __future__ import annotations

import errno
import os
import select
import termios
import time
from contextlib import suppress
from pathlib import Path

import serial
from serial.tools import list_ports

from mecazen_hardware.errors import HardwareError

BUSY_FOR_S = 1.0
"""Maximum wait for the port [s]: after a driver was killed, its keeper holds the port for a
moment."""
SOCKET = "socket://"


class Port:
    """An open serial port or TCP connection, exclusive to this process.

    Args:
        name: A device, or `socket://HOST:PORT`.
        baud: Bits per second on a serial line.

    Raises:
        HardwareError: The port can't be opened; the message states the reason and the remedy.
    """

    def __init__(self, name: str, baud: int) -> None:
        self.name = name
        self._serial = _open(name, baud)
        self.fd: int = self._serial.fileno()
        os.set_blocking(self.fd, False)

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived, after a wait of at most `timeout_s`.

        Raises:
            HardwareError: The port has gone.
        """
        ready, _, _ = select.select([self.fd], [], [], timeout_s)
        if not ready:
            return b""
        try:
            data = os.read(self.fd, 4096)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self.gone(error) from None
        if not data:
            raise self.gone()
        return data

    def write(self, frame: bytes) -> bool:
        """Send a frame; return whether there was room for it.

        Raises:
            HardwareError: The port has gone.
        """
        try:
            return os.write(self.fd, frame) == len(frame)
        except BlockingIOError:
            return False
        except OSError as error:
            raise self.gone(error) from None

    def gone(self, error: OSError | None = None) -> HardwareError:
        """Return the error for a port that was disconnected."""
        why = f" ({error.strerror})" if error is not None else ""
        return HardwareError(
            f"{self.name}: the port has gone in mid-run{why}: unplugged, or without power? The "
            "robot may still be driving: switch it off"
        )

    def close(self) -> None:
        """Close the port."""
        with suppress(OSError):
            self._serial.close()


def _open(name: str, baud: int) -> serial.SerialBase:
    begin_s = time.monotonic()
    while True:
        try:
            if name.startswith(SOCKET):
                return serial.serial_for_url(name)
            return serial.Serial(name, baud, timeout=0, exclusive=True)
        except (serial.SerialException, OSError) as error:
            number = error.errno if error.errno is not None else _errno_of(error)
            taken = number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK)
            if taken and time.monotonic() - begin_s < BUSY_FOR_S:
                time.sleep(0.05)
                continue
            raise HardwareError(f"{name}: {_reason(name, number, error)}") from None


def _errno_of(error: BaseException) -> int | None:
    """Return the errno of the system error behind an error of pyserial."""
    cause = error.__context__
    return int(cause.args[0]) if isinstance(cause, OSError | termios.error) else None


def _reason(name: str, number: int | None, error: Exception) -> str:
    if number == errno.ENOENT:
        found = ", ".join(one.device for one in candidates()) or "none"
        return f"no such port; ports here: {found}"
    if number in (errno.EACCES, errno.EPERM):
        group = Path(name).group()
        return (
            f"no permission; `sudo usermod -aG {group} $USER`, and log in again, if the port "
            f"belongs to the group {group}"
        )
    if number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK):
        return "in use by another program: one driver at a time"
    if number in (errno.ECONNREFUSED, errno.ETIMEDOUT, errno.EHOSTUNREACH, errno.ENETUNREACH):
        return "no robot answers there: is its Wi-Fi joined, and the robot on?"
    if number == errno.ENOTTY:
        return "not a serial port"
    return f"can't be opened: {error}"


def candidates() -> list[list_ports.ListPortInfo]:
    """Return the serial ports of connected USB adapters, those of a CH340 first."""
    ports = [one for one in list_ports.comports() if one.vid is not None]
    return sorted(ports, key=lambda one: (one.vid != 0x1A86, one.device))
