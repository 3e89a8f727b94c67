"""The boards that are known by name, and how a driver opens the link to one."""

from __future__ import annotations

from mecazen.config import HardwareConfig
from mecazen.robot import Robot

from mecazen_hardware.board import Board
from mecazen_hardware.dry import DryLink
from mecazen_hardware.link import Link
from mecazen_hardware.port import Port
from mecazen_hardware.robomaster_ep import RobomasterEp
from mecazen_hardware.rosmaster_x3 import RosmasterX3

BOARDS: dict[str, type[Board]] = {"rosmaster_x3": RosmasterX3, "robomaster_ep": RobomasterEp}


def open_link(config: HardwareConfig, robot: Robot) -> Link | DryLink:
    """Return the link to the board of a scenario, which has answered.

    Raises:
        HardwareError: The port can't be opened, or the board does not answer as it should.
    """
    board = BOARDS[config.board](config, robot)
    if config.dry_run:
        return DryLink(board)
    port = Port(config.port, board.BAUD)
    return Link(board, port, port.fd)
