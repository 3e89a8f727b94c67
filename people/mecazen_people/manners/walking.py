"""The common parts of all manners: errands, other people and things, and the body's turns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

from mecazen.config.people import Goal
from mecazen.geometry import Pose2D, Twist2D, rotate, wrap

from mecazen_people.motion import Motion
from mecazen_people.recorded import MAX_YAW_RATE, STANDING_M_S

STEP_S = 0.1
"""Time between two choices of the velocities by ORCA and SFM [s]."""
SPEED_M_S = 1.5
"""Preferred speed of the pedestrians of Follow-Bench."""
TURN_HZ = 5.0
"""Gain with which a body turns to its direction of travel."""


class Outline(NamedTuple):
    """A rectangle about a place: extent ahead, behind and to each side [m]; heading [rad]."""

    ahead: float
    behind: float
    side: float
    yaw: float

    def gap(self, dx: float, dy: float) -> float:
        """Return the distance of a point from the outline; `dx` and `dy` are from the place [m]."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        along, across = c * dx + s * dy, abs(c * dy - s * dx)
        over = max(along - self.ahead, -self.behind - along, 0.0)
        beside = max(across - self.side, 0.0)
        return math.sqrt(over * over + beside * beside)


class Other(NamedTuple):
    """Another person or thing that moves: a disc, or a disc with an outline."""

    x: float
    y: float
    vx: float
    vy: float
    radius: float
    outline: Outline | None = None
    is_heeded: bool = True
    """Whether people give way to this; otherwise they only brake when they touch it."""

    def gap(self, x: float, y: float) -> float:
        """Return the distance of a place from the outline, or else from the disc [m]."""
        dx, dy = x - self.x, y - self.y
        if self.outline is not None:
            return self.outline.gap(dx, dy)
        return math.sqrt(dx * dx + dy * dy) - self.radius


class Errand(NamedTuple):
    """The goals of a walker."""

    start: Pose2D
    goals: tuple[tuple[float, float], ...]
    """Goals, in this order."""
    endless: bool = False
    """Whether the first goal follows again after the last."""
    speed: float = SPEED_M_S
    start_after: float = 0.0
    safe: float = 0.5
    """Distance to be kept from others beyond the walker's own body [m]: for ORCA and SFM."""
    plans: bool = True
    """Whether the way leads round obstacles: for ORCA and SFM."""
    within: float = 2.0
    """Distance at which a way-point is reached [m]: for ORCA and SFM."""

    @classmethod
    def of(cls, path: Goal) -> Errand:
        """Return the errand of a path."""
        start = Pose2D(path.x_m, path.y_m, math.radians(path.yaw_deg))
        goals = (*path.via_m, path.goal_m)
        if path.back_and_forth:
            goals = (*goals, *path.via_m[::-1], (path.x_m, path.y_m))
        return cls(
            start,
            goals,
            path.back_and_forth,
            path.speed_m_s,
            path.start_after_s,
            path.keeps_m,
            within=path.within_m,
        )


class Walkers(Protocol):
    """People on errands."""

    motions: list[Motion]
    """Current motion of each walker."""

    def step(self, time: float, dt: float, others: Sequence[Other]) -> None:
        """Advance the walkers by `dt` to `time` [s]; they give way to `others`."""


def walked(last: Motion, place: Sequence[float], velocity: Sequence[float], dt: float) -> Motion:
    """Return a walker's motion; the body turns to its direction of travel at a human rate."""
    (x, y), (vx, vy), yaw = place, velocity, last.pose.yaw
    speed, rate = math.hypot(vx, vy), 0.0
    if speed > STANDING_M_S:
        lag = wrap(math.atan2(vy, vx) - yaw)
        rate = min(max(TURN_HZ * lag, -MAX_YAW_RATE), MAX_YAW_RATE)
    yaw = wrap(yaw + rate * dt)
    return Motion(
        Pose2D(x, y, yaw), Twist2D(*rotate(vx, vy, -yaw), rate), last.distance + speed * dt
    )
