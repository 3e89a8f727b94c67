"""What a path says of the person at one time."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from mecazen.geometry import Pose2D, Twist2D


class Motion(NamedTuple):
    """The person's motion at one time."""

    pose: Pose2D
    """Pose in the world; yaw is the heading."""
    twist: Twist2D = Twist2D()
    """Velocity in the person's own frame: x forward, y left."""
    distance: float = 0.0
    """Distance walked since the start [m]."""


class Path(Protocol):
    """A motion that is known for all times."""

    @property
    def duration(self) -> float:
        """Time at which the person comes to stand for good [s]; inf if there is none."""

    def at(self, t: float) -> Motion:
        """Return the motion at the time `t` [s]: any, standing before 0 and after the end."""
