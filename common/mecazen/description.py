"""What the robot looks like: asked of whoever simulates it, or has a recording of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from mecazen import keys
from mecazen.bus import Bus
from mecazen.messages import Empty, String


class RobotDescription(NamedTuple):
    """A robot's URDF and its meshes."""

    urdf: str
    meshes: Mapping[str, bytes]
    """Files by the names that the URDF gives them."""


def serve_description(bus: Bus, description: RobotDescription) -> None:
    """Answer queries on `robot_description` with the URDF, and below it with the meshes."""
    urdf = String(data=description.urdf)
    bus.serve(keys.ROBOT_DESCRIPTION, lambda _, reply: reply.answer(urdf))
    bus.serve_files(keys.ROBOT_DESCRIPTION.key, description.meshes)


def ask_description(bus: Bus, timeout_s: float) -> RobotDescription:
    """Return what somebody answers.

    Raises:
        BusError: Nobody does.
    """
    key = keys.ROBOT_DESCRIPTION.key
    urdf = bus.call(keys.ROBOT_DESCRIPTION, Empty(), timeout_s).data
    files = bus.fetch_files(f"{key}/*/**", timeout_s)
    return RobotDescription(
        urdf, {name.removeprefix(f"{key}/"): data for name, data in files.items()}
    )
