"""What can go wrong in the simulated world."""

from __future__ import annotations

from mecazen.errors import MecazenError


class DivergedError(MecazenError):
    """The simulated state makes no sense any more."""


class UnsupportedError(MecazenError):
    """The installed dartpy would simulate something else than was asked for."""
