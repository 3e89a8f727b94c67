"""The bus: within a process, and over Zenoh between processes.

Both call a service's handlers on the thread of the service, so a service needs no locks. The bus
over Zenoh calls them in `Bus.spin_once`, the local bus when a sample is published.
"""

from mecazen.bus.base import Bus, Presence, Publisher, Reply, StoppedError

__all__ = ["Bus", "Presence", "Publisher", "Reply", "StoppedError"]
