"""The person's motion: on a path that gives it for any time, or driven by twists."""

from __future__ import annotations

import math
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


class Driven:
    """The person moves with the last commanded twist, from `start` in the world.

    They stop `timeout` [s] after the last command; `tick_s` is the duration of a step.
    """

    def __init__(self, start: Pose2D, timeout: float, tick_s: float) -> None:
        self.motion = Motion(start)
        """The current motion."""
        self._command = Twist2D()
        self._tick_s = tick_s
        self._timeout_ticks = math.ceil(timeout / tick_s - 1e-9)
        self._ticks_left = 0

    def command(self, twist: Twist2D) -> None:
        """Set the twist [m/s, rad/s] in the person's frame for the next steps."""
        self._command = twist
        self._ticks_left = self._timeout_ticks

    def step(self, ticks: int = 1) -> Motion:
        """Advance by `ticks` >= 1 and return the new motion."""
        moving = min(ticks, self._ticks_left)
        self._ticks_left -= moving
        pose, _, distance = self.motion
        twist, duration = self._command, moving * self._tick_s
        walked = math.hypot(twist.x, twist.y) * duration
        pose = pose.integrate(twist, duration)
        self.motion = Motion(pose, twist if moving == ticks else Twist2D(), distance + walked)
        return self.motion
