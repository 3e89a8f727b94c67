"""The plug-in for ROS 2: see `mecazen.bridges.Bridge`."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mecazen import keys
from mecazen.config import BusConfig
from mecazen.keys import Call, Topic
from mecazen.messages import Message
from mecazen.robots import join_key
from mecazen.row import Row

from mecazen_ros.parameters import PARAMETER_SERVICES
from mecazen_ros.protocol import ADMIN, any_key, dds_type
from mecazen_ros.services import SERVICES
from mecazen_ros.topics import DESCRIBED, Namespace, name_of, publications, subscriptions

if TYPE_CHECKING:
    from mecazen_ros.node import RosSide


def open_side(config: BusConfig, name: str) -> RosSide:
    """Open the session of a process's ROS nodes.

    Raises:
        BusError: See `open_session`.
    """
    from mecazen_ros.node import RosSide  # noqa: PLC0415  # a router needs no rosbags

    return RosSide(config, name)


def given(row: Row, topic: Topic[Any]) -> list[str]:
    """Return the keys on which ROS receives an output of a node."""
    shown = publications(topic, name_of(row, topic), Namespace(urdf="<robot/>"))
    return [_key(one.name, one.kind) for one in shown]


def taken(topic: Topic[Any], robot: str = "", namespace: str | None = None) -> list[str]:
    """Return the keys on which a topic is received from ROS; in any namespace if none is given."""
    return [
        any_key(join_key(one.name, robot), dds_type(one.kind.ROS_TYPE), namespace)
        for one in subscriptions(topic, topic.key)
    ]


def asked(calls: Collection[Call[Any, Any]]) -> list[str]:
    """Return the keys of the ROS services that make any of the given queries."""
    services = (*SERVICES, *PARAMETER_SERVICES)
    return [any_key(one.name, dds_type(one.kind)) for one in services if one.call in calls]


def latched(call: Call[Any, Any]) -> list[str]:
    """Return the keys on which an answer to a query is published once, for late subscribers."""
    if call is not keys.ROBOT_DESCRIPTION:
        return []
    return [_key(name, kind) for name, kind in DESCRIBED.items()]


def tokens(service: str = "") -> str:
    """Return the liveliness tokens of a service's ROS node; of all services if none is named."""
    return f"{ADMIN}/*/*/*/*/*/*/*/{service}/**" if service else f"{ADMIN}/**"


def files(root: Path) -> Iterator[tuple[Path, str]]:
    """Yield each file of the package `mecazen_msgs`, and its content."""
    from mecazen_ros import package  # noqa: PLC0415  # a router needs no rosbags

    yield from package.files(root / "ros2" / package.NAME)


def _key(name: str, kind: type[Message]) -> str:
    return any_key(name, dds_type(kind.ROS_TYPE))
