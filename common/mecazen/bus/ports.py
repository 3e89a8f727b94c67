"""Free TCP ports."""

import random
import socket
from pathlib import Path

LOOPBACK = "127.0.0.1"
FIRST = 10_000
"""Lowest port that is tried; most well-known services use lower ports."""


def probe(port: int, address: str = LOOPBACK) -> None:
    """Listen on a port of an address for a moment; raises OSError if no server can."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    socket.create_server((address, port), family=family).close()


def is_free(port: int, address: str = LOOPBACK) -> bool:
    """Return whether a server can listen on a port of an address."""
    try:
        probe(port, address)
    except OSError:
        return False
    return True


def free_port() -> int:
    """Return a free port of loopback below the kernel's range, if it leaves any.

    A connection could take a port of that range before a server listens on it.
    """
    kernel = Path("/proc/sys/net/ipv4/ip_local_port_range").read_text(encoding="ascii")
    end = int(kernel.split()[0])
    ports = range(FIRST, end if end > FIRST else 1 << 16)
    while not is_free(port := random.SystemRandom().choice(ports)):
        pass
    return port
