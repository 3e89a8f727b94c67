"""The person's motion, and paths that give it for any time."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from mecazen.geometry import Pose2D, Twist2D


class Motion(NamedTuple):
    """The person's motion at one time."""

    pose: Pose2D
    """Pose in the world; yaw is the heading."""
    twist: Twist2D = Twist2D()
    """Velocity in the person's frame: x forward, y left."""
    distance: float = 0.0
    """Distance travelled since the start [m]."""


class Path(Protocol):
    """A motion known for all times."""

    @property
    def duration(self) -> float:
        """Time from which on the person stands [s]; inf for an endless path."""

    def at(self, t: float) -> Motion:
        """Return the motion at any time `t` [s]; at rest before 0 and after the end."""
