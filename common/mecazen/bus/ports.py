"""Free ports of loopback."""

import random
import socket
from pathlib import Path

LOOPBACK = "127.0.0.1"
FIRST = 10_000
"""Lowest port that is tried; most well-known services use lower ports."""


def is_free(port: int) -> bool:
    """Return whether a server can listen on a TCP port."""
    try:
        with socket.create_server((LOOPBACK, port)):
            return True
    except OSError:
        return False


def free_port() -> int:
    """Return a free TCP port below the kernel's range, if it leaves any.

    A connection could take a port of that range before a server listens on it.
    """
    kernel = Path("/proc/sys/net/ipv4/ip_local_port_range").read_text(encoding="ascii")
    end = int(kernel.split()[0])
    ports = range(FIRST, end if end > FIRST else 1 << 16)
    while not is_free(port := random.SystemRandom().choice(ports)):
        pass
    return port
