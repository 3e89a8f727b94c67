"""Errors of the simulated world."""

from __future__ import annotations

from mecazen.errors import MecazenError


class DivergedError(MecazenError):
    """The simulated state is no longer plausible."""


class UnsupportedError(MecazenError):
    """Physics cannot simulate what the scenario specifies."""
