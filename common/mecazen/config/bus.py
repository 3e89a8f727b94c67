"""`[bus]`: the Zenoh sessions."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from mecazen.schema import Folder, Section

ROUTER = "tcp/127.0.0.1:7447"
"""The router's endpoint unless the scenario names another."""


SECURE_ROUTER = "tls/127.0.0.1:7447"
"""The same where there are certificates."""


class BusConfig(Section):
    """Zenoh: loopback and no multicast unless something else is said here."""

    connect: tuple[str, ...] | None = None
    """Endpoints of the router; ["tcp/127.0.0.1:7447"] where neither this nor a file says."""
    listen: tuple[str, ...] | None = None
    """Endpoints of each peer; ["tcp/127.0.0.1:0"], a free port, where nothing else is said."""
    insecure: bool = False
    """Whether endpoints beyond loopback may do without TLS: anyone there then drives the robot."""
    mode: Literal["peer", "client"] = "peer"
    """peer: services speak with each other directly; client: all through the router, which alone
    listens. A client finds its way back after any cut: for several hosts."""
    multicast_scouting: bool = False
    """Whether sessions look for each other by multicast."""
    namespace: Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_-]+(/[A-Za-z0-9_-]+)*$")] | None = (
        None
    )
    """Prefix of all keys, put there by Zenoh; one for each robot."""
    format: Literal["json", "msgpack"] = "json"
    """How samples are written; both are always read."""
    zenoh_config: Path | None = None
    """A Zenoh configuration file (JSON5) that the settings above are laid over."""
    keys: Folder | None = None
    """A folder of `mecazen keys create`: all links are TLS, with certificates at both ends."""
    ros2: bool = False
    """Whether the services are ROS 2 nodes as well, in the protocol of rmw_zenoh."""
    ros_domain_id: Annotated[int, msgspec.Meta(ge=0, le=232)] = 0
    """As ROS_DOMAIN_ID."""
    ros_connect: tuple[str, ...] | None = None
    """Endpoints of `rmw_zenohd`, where it runs beside the own router; left out: `connect`."""
    ros_distro: Literal["humble", "jazzy"] = "jazzy"
    """jazzy: that and all later ones; humble has no hashes of types, and hears no other."""

    def __post_init__(self) -> None:
        if self.ros2 and re.search(r"(^|/)[^A-Za-z_]|-", self.namespace or ""):
            raise ValueError(
                f"ros2: {self.namespace!r} can't be a namespace in ROS, whose names have letters, "
                "digits and _, and begin with no digit"
            )

    @property
    def router_endpoints(self) -> tuple[str, ...] | None:
        """Endpoints of the router; None where only the Zenoh configuration file knows."""
        if self.connect or self.zenoh_config:
            return self.connect
        return (SECURE_ROUTER if self.keys else ROUTER,)

    def within(self, name: str) -> BusConfig:
        """Return the bus of one of several robots: its name ends the namespace."""
        namespace = "/".join(filter(None, (self.namespace, name)))
        return msgspec.structs.replace(self, namespace=namespace or None)
