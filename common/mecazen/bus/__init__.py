"""The bus: over Zenoh between processes, and a local one within a process.

Both call a service's handlers on the thread of the service, so a service needs no locks. The bus
over Zenoh calls them in `Bus.spin_once`, the local bus when a sample is published.
"""

from mecazen.bus.base import Bus, Presence, Publisher, Reply, StoppedError
from mecazen.bus.local import LocalBus

__all__ = ["Bus", "LocalBus", "Presence", "Publisher", "Reply", "StoppedError"]
