"""A person driven by commanded twists."""

from __future__ import annotations

import math

from mecazen.geometry import Pose2D, Twist2D

from mecazen_target.motion import Motion


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
