"""The robot's appearance, as URDF and meshes, served by the physics or by a replay."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from mecazen import keys
from mecazen.bus import Bus
from mecazen.keys import call_of_robot
from mecazen.messages import Empty, String


class RobotDescription(NamedTuple):
    """A robot's URDF and its meshes."""

    urdf: str
    meshes: Mapping[str, bytes]
    """Files by the names that the URDF gives them."""


def serve_description(bus: Bus, robot: str, description: RobotDescription) -> None:
    """Answer queries on `robot_description` with the URDF, and below it with the meshes."""
    call, urdf = call_of_robot(keys.ROBOT_DESCRIPTION, robot), String(data=description.urdf)
    bus.serve(call, lambda _, reply: reply.answer(urdf))
    bus.serve_files(call.key, description.meshes)


def ask_description(bus: Bus, robot: str, timeout_s: float) -> RobotDescription:
    """Return the description that a service gives of a robot.

    Raises:
        BusError: No service answers.
    """
    call = call_of_robot(keys.ROBOT_DESCRIPTION, robot)
    urdf = bus.call(call, Empty(), timeout_s).data
    files = bus.fetch_files(f"{call.key}/*/**", timeout_s)
    return RobotDescription(
        urdf, {name.removeprefix(f"{call.key}/"): data for name, data in files.items()}
    )
