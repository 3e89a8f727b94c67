"""Free ports of loopback."""

from __future__ import annotations

import random
import socket
from contextlib import suppress
from pathlib import Path

LOOPBACK = "127.0.0.1"
FIRST = 10_000
"""The lowest port that is tried: services that have a port of their own are mostly below."""
_GIVEN_BY_THE_KERNEL = Path("/proc/sys/net/ipv4/ip_local_port_range")


def free_port() -> int:
    """Return a free TCP port.

    It is below those that the kernel gives to connections: one of these could take it before
    it is listened on.
    """
    end = int(_GIVEN_BY_THE_KERNEL.read_text(encoding="ascii").split()[0])
    if end <= FIRST:
        end = 1 << 16  # there are none below
    while True:
        port = random.SystemRandom().randrange(FIRST, end)
        with suppress(OSError), socket.create_server((LOOPBACK, port)):
            return port
