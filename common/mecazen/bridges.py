"""Packages that show the nodes of a process to another system: ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from mecazen.config import BusConfig
from mecazen.errors import BusError
from mecazen.extras import is_installed
from mecazen.keys import Call, Topic
from mecazen.messages import Message
from mecazen.row import Row

if TYPE_CHECKING:
    from mecazen.bus.zenoh_bus import ZenohBus
    from mecazen.config import Scenario
    from mecazen.graph import Graph

Put = Callable[[Topic[Any], Message], None]
"""Publishes a message without a stamp."""


class Side(Protocol):
    """The other system's side of a process."""

    def show(
        self, name: str, robot: str, bus: ZenohBus, put: Put, scenario: Scenario, graph: Graph
    ) -> None:
        """Show a service: its outputs, its inputs and the queries that it answers.

        Args:
            name: Name of the service.
            robot: Name of the service's robot, if there are several robots.
            bus: The bus of the service's process.
            put: Publishes a message without a stamp, in this process and elsewhere.
            scenario: The scenario as the service's robot sees it.
            graph: The nodes of the scenario.
        """

    def close(self) -> None:
        """Leave the other system."""


class Bridge(Protocol):
    """A module that shows nodes; returned lists hold key expressions of the other system."""

    def open_side(self, config: BusConfig, name: str) -> Side:
        """Join the other system, with the certificate of the service `name`."""

    def given(self, row: Row, topic: Topic[Any]) -> list[str]:
        """Return the keys on which the other system receives an output of a node."""

    def taken(self, topic: Topic[Any], robot: str = "", namespace: str | None = None) -> list[str]:
        """Return the keys on which a topic is received; in any namespace if none is given."""

    def asked(self, calls: Collection[Call[Any, Any]]) -> list[str]:
        """Return the keys on which any of the given queries can be made."""

    def latched(self, call: Call[Any, Any]) -> list[str]:
        """Return the keys on which an answer to a query is published for late subscribers."""

    def tokens(self, service: str = "") -> str:
        """Return the liveliness tokens of a service; of all services if no name is given."""

    def files(self, root: Path) -> Iterator[tuple[Path, str]]:
        """Yield the path and the content of each file that is generated from the graph."""


@cache
def installed() -> list[Bridge]:
    """Return all bridges that are installed."""
    return [cast(Bridge, import_module("mecazen_ros.bridge"))] if is_installed("ros2") else []


def bridge_of(config: BusConfig) -> Bridge | None:
    """Return the bridge that the settings of a bus ask for.

    Raises:
        BusError: It is not installed.
    """
    if not config.ros2:
        return None
    for bridge in installed():
        return bridge
    raise BusError("bus.ros2 needs pip install 'mecazen[ros2]'")


def is_bridged(key: str) -> bool:
    """Return whether a key belongs to a bridge: only such keys contain `::`."""
    return "::" in key
