"""Errors of a real robot that are shown in one line."""

from mecazen.errors import MecazenError


class HardwareError(MecazenError):
    """The port or the board can't be used, or was disconnected."""
