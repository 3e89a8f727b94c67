"""mecazen: messages, bus, time and configuration of the simulator; `Simulation` runs a scenario."""

from importlib import import_module
from typing import Any

__all__ = ["Simulation"]


def __getattr__(name: str) -> Any:
    """Import `Simulation` from mecazen_tools when it is used, since nodes do not need it."""
    if name != "Simulation":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module("mecazen_tools.simulation").Simulation
