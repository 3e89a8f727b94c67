"""A scripted walk: velocities one after the other, reached with a limited acceleration."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mecazen.geometry import Pose2D, Twist2D

from mecazen_people.motion import Motion

_CELL_S = 0.005
"""Within a cell the velocity is that of its middle: a stop from 1.8 m/s is 2 mm off at most."""


class Script:
    """Velocities in the person's frame, one after the other, from the origin along x.

    Args:
        steps: Pairs of duration [s] and velocity; after the last the person comes to rest.
        acceleration: Largest change of the planar velocity [m/s²].
        yaw_acceleration: Largest change of the yaw rate [rad/s²].
    """

    def __init__(
        self, steps: Sequence[tuple[float, Twist2D]], acceleration: float, yaw_acceleration: float
    ) -> None:
        self._cells: list[Motion] = []
        pose, twist, walked, end = Pose2D(), Twist2D(), 0.0, 0.0
        for duration, wanted in (*steps, (math.inf, Twist2D())):
            end += duration
            while len(self._cells) * _CELL_S < end - 1e-9:
                if twist == wanted and math.isinf(end):
                    break
                before = twist
                change = acceleration * _CELL_S, yaw_acceleration * _CELL_S
                twist = _towards(twist, wanted, *change)
                middle = Twist2D(*((a + b) / 2 for a, b in zip(before, twist, strict=True)))
                self._cells.append(Motion(pose, middle, walked))
                pose = pose.integrate(middle, _CELL_S)
                walked += math.hypot(middle.x, middle.y) * _CELL_S
        self._last = Motion(pose, Twist2D(), walked)
        self.duration = len(self._cells) * _CELL_S

    def at(self, t: float) -> Motion:
        """Return the motion at the time `t` [s]; at rest before 0 and after the end."""
        if t < 0.0:
            return Motion(Pose2D())
        number = math.floor(t / _CELL_S + 1e-9)
        if number >= len(self._cells):
            return self._last
        pose, twist, walked = self._cells[number]
        since = max(t - number * _CELL_S, 0.0)
        return Motion(
            pose.integrate(twist, since), twist, walked + math.hypot(twist.x, twist.y) * since
        )


def _towards(twist: Twist2D, wanted: Twist2D, linear: float, yaw: float) -> Twist2D:
    """Return a twist moved towards `wanted` by at most `linear` and `yaw`."""
    dx, dy, dw = wanted.x - twist.x, wanted.y - twist.y, wanted.yaw - twist.yaw
    size = math.hypot(dx, dy)
    share = min(1.0, linear / size) if size else 0.0
    return Twist2D(
        wanted.x if share == 1.0 else twist.x + share * dx,
        wanted.y if share == 1.0 else twist.y + share * dy,
        wanted.yaw if abs(dw) <= yaw else twist.yaw + math.copysign(yaw, dw),
    )
