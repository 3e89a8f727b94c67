"""Whether one service is alive: `python -m mecazen.health NAME`, as a container's health check.

Containers run this check every few seconds, so it imports little: the bus, and no service.
"""

from __future__ import annotations

import argparse
import os
import sys

from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import BusConfig
from mecazen.errors import MecazenError
from mecazen.loading import (
    SCENARIO_VARIABLE,
    SETTINGS_VARIABLE,
    load_bus,
    parse_settings,
    scenario_path,
)

ROUTER = "router"


def health(name: str, config: BusConfig) -> str:
    """Return the state of a service by its liveliness tokens, or the state of the router.

    Raises:
        MecazenError: The service is not alive, or the router can't be connected to.
    """
    bus = ZenohBus(config, "client")
    try:
        alive = bus.alive()
    finally:
        bus.close()
    if name == ROUTER:
        return "listens"
    if name not in alive:
        raise MecazenError(f"{name} is not on the bus")
    return "ready" if f"{name}/ready" in alive else "waiting for others"


def main() -> None:
    """Print one line; end with 0 if the service is alive, else with 1."""
    parser = argparse.ArgumentParser(
        prog="python -m mecazen.health",
        description=f"Ask whether a service of {SCENARIO_VARIABLE} is alive, whose bus "
        f"{SETTINGS_VARIABLE} may change.",
    )
    parser.add_argument("service", help="its name, or router")
    parser.add_argument("--robot", default="", metavar="NAME", help="of several, whose service")
    options = parser.parse_args()
    name = options.service
    try:
        path = scenario_path(os.environ.get(SCENARIO_VARIABLE, ""))
        settings = parse_settings(os.environ.get(SETTINGS_VARIABLE, "").split())
        print(f"{name}: {health(name, load_bus(path, settings).within(options.robot))}")
    except MecazenError as error:
        print(f"error: {error}")
        sys.exit(1)


if __name__ == "__main__":
    main()
