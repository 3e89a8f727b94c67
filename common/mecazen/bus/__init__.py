"""The bus: over Zenoh between processes, and a local one within a process.

Both deliver in `Bus.spin_once`, on the thread that calls it, so a service needs no locks.
"""

from mecazen.bus.base import Bus, Presence, Publisher, Reply, StoppedError
from mecazen.bus.local import LocalBus

__all__ = ["Bus", "LocalBus", "Presence", "Publisher", "Reply", "StoppedError"]
