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
"""The same if there are certificates."""


class BusConfig(Section):
    """Zenoh sessions: on loopback and without multicast unless these settings change that."""

    connect: tuple[str, ...] | None = None
    """Endpoints of the router; default without `zenoh_config`: ["tcp/127.0.0.1:7447"]."""
    listen: tuple[str, ...] | None = None
    """Endpoints of each peer; default without `zenoh_config`: ["tcp/127.0.0.1:0"], a free port."""
    insecure: bool = False
    """Whether endpoints beyond loopback may be without TLS: any program there can then drive the
    robot."""
    mode: Literal["peer", "client"] = "peer"
    """peer: services connect to each other directly; client: only to the router, which is the only
    process that listens. Clients reconnect after any interruption: use them on several hosts."""
    multicast_scouting: bool = False
    """Whether sessions look for each other by multicast."""
    namespace: Annotated[str, msgspec.Meta(pattern="^[A-Za-z0-9_-]+(/[A-Za-z0-9_-]+)*$")] | None = (
        None
    )
    """Prefix that Zenoh adds to all keys; one for each robot."""
    zenoh_config: Path | None = None
    """A Zenoh configuration file (JSON5), which the settings of this section override."""
    keys: Folder | None = None
    """A folder made by `mecazen keys create`: all links use TLS, with certificates at both ends."""
    ros2: bool = False
    """Whether the services are ROS 2 nodes as well, in the protocol of rmw_zenoh."""
    ros_domain_id: Annotated[int, msgspec.Meta(ge=0, le=232)] = 0
    """Domain of ROS 2, as the variable ROS_DOMAIN_ID sets it."""
    ros_connect: tuple[str, ...] | None = None
    """Endpoints of `rmw_zenohd`, if it runs beside mecazen's router; left out: `connect`."""
    ros_bridge: tuple[str, ...] | None = None
    """Endpoints of a `zenoh-bridge-ros2dds`, for ROS on DDS: its keys and plain CDR take the place
    of rmw_zenoh's protocol. Implies `ros2`."""
    ros_odom_tf: bool = True
    """Whether ROS sees the odometry on `/tf` as well; false if a filter such as robot_localization
    publishes that transform."""
    ros_distro: Literal["humble", "jazzy"] = "jazzy"
    """jazzy: Jazzy and all later distributions. humble: Humble, which has no type hashes and
    receives from no other distribution."""

    def __post_init__(self) -> None:
        for name in ("connect", "listen", "ros_connect", "ros_bridge"):
            endpoints = getattr(self, name) or ()
            if any("://" in endpoint for endpoint in endpoints):
                # the form of a URL, tcp://host:port, is Zenoh's tcp/host:port
                written = tuple(endpoint.replace("://", "/", 1) for endpoint in endpoints)
                msgspec.structs.force_setattr(self, name, written)
        if self.ros_bridge:
            msgspec.structs.force_setattr(self, "ros2", True)
            if self.ros_connect:
                raise ValueError("ros_bridge and ros_connect: ROS is reached by one of them")
            ends = " ".join(self.router_endpoints or ()).replace("localhost", "127.0.0.1").split()
            if any(end.replace("localhost", "127.0.0.1") in ends for end in self.ros_bridge):
                raise ValueError(
                    "ros_bridge: this is mecazen's own router, where the same keys have JSON; "
                    "connect needs another port"
                )
        if self.ros2 and re.search(r"(^|/)[^A-Za-z_]|-", self.namespace or ""):
            raise ValueError(
                f"ros2: {self.namespace!r} can't be a namespace in ROS, whose names have letters, "
                "digits and _, and begin with no digit"
            )

    @property
    def router_endpoints(self) -> tuple[str, ...] | None:
        """Endpoints of the router; None if only the Zenoh configuration file names them."""
        if self.connect or self.zenoh_config:
            return self.connect
        return (SECURE_ROUTER if self.keys else ROUTER,)

    def within(self, name: str) -> BusConfig:
        """Return the bus of one of several robots: the robot's name ends the namespace."""
        namespace = "/".join(filter(None, (self.namespace, name)))
        return msgspec.structs.replace(self, namespace=namespace or None)
