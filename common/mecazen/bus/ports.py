"""Free ports of loopback."""

from __future__ import annotations

import random
import socket
from pathlib import Path

LOOPBACK = "127.0.0.1"
FIRST = 10_000
"""Lowest port that is tried; most well-known services use lower ports."""
_GIVEN_BY_THE_KERNEL = Path("/proc/sys/net/ipv4/ip_local_port_range")


def is_free(port: int) -> bool:
    """Return whether a server can listen on a TCP port."""
    try:
        with socket.create_server((LOOPBACK, port)):
            return True
    except OSError:
        return False


def free_port() -> int:
    """Return a free TCP port.

    The port is below the range from which the kernel assigns ports to connections. A connection
    could take a port of that range before a server listens on it.
    """
    end = int(_GIVEN_BY_THE_KERNEL.read_text(encoding="ascii").split()[0])
    if end <= FIRST:
        end = 1 << 16  # the kernel's range leaves no ports below it
    while True:
        port = random.SystemRandom().randrange(FIRST, end)
        if is_free(port):
            return port
