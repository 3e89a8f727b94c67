"""The input of a planner of Follow-Bench in each step, and the interface that it implements."""

from __future__ import annotations

from typing import Literal, NamedTuple, Protocol

from mecazen.geometry import Pose2D
from mecazen.portable import Floats

Place = Literal["back", "left_side"]
"""Place of the robot: behind the target, or beside it, on either side."""


class Seen(NamedTuple):
    """Position [m] and velocity [m/s] of a person that the robot sees, in the world."""

    x: float
    y: float
    vx: float
    vy: float


class View(NamedTuple):
    """The input of a planner in one step."""

    time_s: float
    robot: Pose2D
    """Pose of the rear axle in the world."""
    v: float
    """Current speed [m/s]."""
    w: float
    """Current yaw rate [rad/s]."""
    target: Seen | None
    """The target; None while it is out of sight."""
    people: tuple[Seen, ...]
    """The visible people besides the target."""
    ranges: Floats
    """Distances (200) [m] from the axle, counter-clockwise from -180° to 180° relative to the
    robot's heading; 5 m if a beam hits nothing."""
    place: Place
    distance: float
    """Distance to keep from the target [m]."""


class Planner(Protocol):
    """A follower: one command per step."""

    def reset(self, seed: int) -> None:
        """Forget the last episode, and seed random numbers."""

    def command(self, view: View) -> tuple[float, float]:
        """Return speed [m/s] and yaw rate [rad/s] for the next step."""
