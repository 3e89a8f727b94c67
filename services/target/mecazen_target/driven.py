"""A person moved by commanded twists."""

from __future__ import annotations

import math

from mecazen.geometry import Pose2D, Twist2D

from mecazen_target.motion import Motion


class Driven:
    """The person moves by the last commanded twist, from `start` in the world.

    `timeout` [s] after the last command they stop; `tick_s` is the time between two calls
    of `step`.
    """

    def __init__(self, start: Pose2D, timeout: float, tick_s: float) -> None:
        self.motion = Motion(start)
        """Where the person is now, and the twist that brought them there."""
        self._command = Twist2D()
        self._tick_s = tick_s
        self._timeout_ticks = math.ceil(timeout / tick_s - 1e-9)
        self._ticks_left = 0

    def command(self, twist: Twist2D) -> None:
        """Take the twist [m/s, rad/s] in the person's own frame for the next steps."""
        self._command = twist
        self._ticks_left = self._timeout_ticks

    def step(self) -> Motion:
        """Move the person by one tick and return the new motion."""
        twist = self._command if self._ticks_left > 0 else Twist2D()
        self._ticks_left = max(self._ticks_left - 1, 0)
        pose, _, distance = self.motion
        walked = math.hypot(twist.x, twist.y) * self._tick_s
        self.motion = Motion(pose.integrate(twist, self._tick_s), twist, distance + walked)
        return self.motion
