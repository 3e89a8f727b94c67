"""Finds installed boards by name, and opens the link to a board."""

from __future__ import annotations

from importlib.metadata import entry_points

from mecazen.config import HardwareConfig
from mecazen.errors import ConfigError
from mecazen.robot import Robot

from mecazen_hardware.board import Board
from mecazen_hardware.dry import DryLink
from mecazen_hardware.link import Link
from mecazen_hardware.port import Port

BOARDS = "mecazen.boards"
"""The entry-point group in which installed packages register their boards."""


def make_board(config: HardwareConfig, robot: Robot) -> Board:
    """Return the protocol of a board.

    Raises:
        ConfigError: No such board is installed.
    """
    known = {entry.name: entry for entry in entry_points(group=BOARDS)}
    if config.board not in known:
        names = ", ".join(sorted(known))
        raise ConfigError(f"hardware.board: no board {config.board!r}; installed: {names}")
    kind: type[Board] = known[config.board].load()
    return kind(config, robot)


def open_link(config: HardwareConfig, robot: Robot) -> Link | DryLink:
    """Return the link to the configured board, after the board has answered.

    Raises:
        ConfigError: No such board is installed.
        HardwareError: The port can't be opened, or the board does not answer as it should.
    """
    board = make_board(config, robot)
    if config.dry_run:
        return DryLink(board)
    port = Port(config.port, board.BAUD)
    return Link(board, port, port.fd)
