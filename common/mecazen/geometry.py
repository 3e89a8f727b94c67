"""Planar poses and angles: SI units, radians, x forward, y left (REP-103)."""

from __future__ import annotations

import math
from typing import NamedTuple


def wrap(angle: float) -> float:
    """Return `angle` [rad] brought into (-pi, pi].

    >>> wrap(1.5 * math.pi) == -0.5 * math.pi
    True
    """
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


of_three = tuple.__new__
"""Makes a pose or a twist from three numbers, in half the time of a call of the class."""


class Twist2D(NamedTuple):
    """Planar velocity: x, y [m/s] and yaw rate [rad/s]; the caller chooses the frame."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0


class Pose2D(NamedTuple):
    """Planar pose: x, y [m], yaw [rad] of a child frame in a parent frame."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def compose(self, other: Pose2D) -> Pose2D:
        """Transform `other` from this frame into this frame's parent.

        >>> Pose2D(2.0, 1.0, 0.0).compose(Pose2D(0.5, 0.25, 1.0))
        Pose2D(x=2.5, y=1.25, yaw=1.0)
        """
        return self._moved(other.x, other.y, other.yaw)

    def between(self, other: Pose2D) -> Pose2D:
        """Transform `other` from this frame's parent into this frame.

        >>> Pose2D(2.0, 1.0, 0.0).between(Pose2D(2.5, 1.25, 1.0))
        Pose2D(x=0.5, y=0.25, yaw=1.0)
        """
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        dx, dy = other.x - self.x, other.y - self.y
        return of_three(Pose2D, (c * dx + s * dy, -s * dx + c * dy, wrap(other.yaw - self.yaw)))

    def integrate(self, twist: Twist2D, dt: float) -> Pose2D:
        """Return the pose after moving with constant body `twist` for `dt` [s].

        Exact, by the exponential map of SE(2). (1 - cos(a))/a is written as 2 sin²(a/2)/a,
        which is accurate near a = 0; there series replace both quotients.
        """
        a = twist.yaw * dt
        if abs(a) < 1e-4:
            sinc, cosc = 1.0 - a * a / 6.0, a / 2.0 - a * a * a / 24.0
        else:
            sinc, cosc = math.sin(a) / a, 2.0 * math.sin(a / 2.0) ** 2 / a
        dx, dy = twist.x * dt, twist.y * dt
        return self._moved(sinc * dx - cosc * dy, cosc * dx + sinc * dy, a)

    def _moved(self, x: float, y: float, yaw: float) -> Pose2D:
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return of_three(
            Pose2D, (self.x + c * x - s * y, self.y + s * x + c * y, wrap(self.yaw + yaw))
        )

    def distance(self, other: Pose2D) -> float:
        """Return the distance between the two origins [m]."""
        return math.hypot(other.x - self.x, other.y - self.y)


def rotate(x: float, y: float, yaw: float) -> tuple[float, float]:
    """Return the vector (x, y) turned by `yaw` [rad]."""
    c, s = math.cos(yaw), math.sin(yaw)
    return c * x - s * y, s * x + c * y


def to_rectangle(ahead: float, beside: float, half: tuple[float, float]) -> float:
    """Return the distance of a point from a rectangle [m]; inside, it is negative.

    Args:
        ahead: The point's coordinate along the length, from the middle of the rectangle [m].
        beside: The same along the width [m].
        half: Half the length and half the width of the rectangle [m].

    >>> to_rectangle(0.0, -2.0, (1.0, 0.5))
    1.5
    """
    x, y = abs(ahead) - half[0], abs(beside) - half[1]
    return math.hypot(max(x, 0.0), max(y, 0.0)) + min(max(x, y), 0.0)


def overlap(a: Pose2D, half_a: tuple[float, float], b: Pose2D, half_b: tuple[float, float]) -> bool:
    """Return whether two rectangles with their middles at `a` and `b` overlap.

    `half_a` and `half_b` are half the length and half the width [m]. Two rectangles are apart
    exactly if their projections on an axis of one of them are apart.
    """
    for yaw in (a.yaw, a.yaw + math.pi / 2, b.yaw, b.yaw + math.pi / 2):
        c, s = math.cos(yaw), math.sin(yaw)
        reach = 0.0
        for pose, (length, width) in ((a, half_a), (b, half_b)):
            turn = pose.yaw - yaw
            reach += length * abs(math.cos(turn)) + width * abs(math.sin(turn))
        if abs((b.x - a.x) * c + (b.y - a.y) * s) >= reach:
            return False
    return True
