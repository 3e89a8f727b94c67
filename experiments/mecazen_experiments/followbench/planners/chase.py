"""Goals of the reference planners: the place by the target, or its prediction while unseen.

The goals are those of Follow-Bench's own planners (Ye et al., arXiv 2509.10796), so that the
reference planners differ only by their control.
"""

from __future__ import annotations

import math

from mecazen.geometry import Pose2D

from mecazen_experiments.followbench.pedestrians import STEP_S
from mecazen_experiments.followbench.view import Place, Seen, View

AHEAD_S = 2.0
"""Horizon of the prediction [s]."""
SEARCH_M = 0.2
"""Distance from the prediction at which a search ends [m]."""
INITIAL, PROCESS, MEASURED = 0.1**2, 0.05**2, 0.5**2
"""Variances of position [m²] and velocity [m²/s²]: initial, per step, per measurement."""
STANDING_M_S = 0.01
"""Below this speed, a person keeps the previous heading."""


def place(target: Seen, heading: float, robot: Pose2D, where: Place, distance: float) -> Pose2D:
    """Return the goal pose of the robot for a target that walks in the direction `heading` [rad].

    For "back", the goal is on the line from the target to the robot, at any bearing. For
    "left_side", it is on the nearer side.
    """
    if where == "back":
        bearing = math.atan2(target.y - robot.y, target.x - robot.x)
        c, s = math.cos(bearing), math.sin(bearing)
        return Pose2D(target.x - distance * c, target.y - distance * s, bearing)
    across_x, across_y = -distance * math.sin(heading), distance * math.cos(heading)
    left = Pose2D(target.x + across_x, target.y + across_y, heading)
    right = Pose2D(target.x - across_x, target.y - across_y, heading)
    to_left = math.hypot(left.x - robot.x, left.y - robot.y)
    return left if to_left <= math.hypot(right.x - robot.x, right.y - robot.y) else right


class ConstantVelocity:
    """Kalman filter of a position and velocity that are both measured.

    The axes share one covariance, since all their variances are equal.
    """

    def __init__(self, first: Seen) -> None:
        self._state = first
        self._pp, self._pv, self._vv = INITIAL, 0.0, INITIAL

    def step(self, measured: Seen) -> None:
        """Predict one step, and correct by a measurement."""
        pp = self._pp + STEP_S * (2.0 * self._pv + STEP_S * self._vv) + PROCESS
        pv, vv = self._pv + STEP_S * self._vv, self._vv + PROCESS
        det = (pp + MEASURED) * (vv + MEASURED) - pv * pv
        # the gain is P (P + R)^-1, with rows for position and velocity
        kpp, kpv = (pp * (vv + MEASURED) - pv * pv) / det, pv * MEASURED / det
        kvv = (vv * (pp + MEASURED) - pv * pv) / det
        x, y, vx, vy = self._state
        x, y = x + STEP_S * vx, y + STEP_S * vy
        ex, ey, evx, evy = measured.x - x, measured.y - y, measured.vx - vx, measured.vy - vy
        self._state = Seen(
            x + kpp * ex + kpv * evx,
            y + kpp * ey + kpv * evy,
            vx + kpv * ex + kvv * evx,
            vy + kpv * ey + kvv * evy,
        )
        # (I - K) P = K R
        self._pp, self._pv, self._vv = kpp * MEASURED, kpv * MEASURED, kvv * MEASURED

    def ahead(self, seconds: float) -> Seen:
        """Return the state predicted some seconds ahead."""
        x, y, vx, vy = self._state
        return Seen(x + seconds * vx, y + seconds * vy, vx, vy)


class Chase:
    """The goal of each step, and the last sight of the target.

    As in Follow-Bench, the filter is updated only during a search, with the last sight as
    measurement, and keeps its state from one search to the next.
    """

    def __init__(self) -> None:
        self.last: Seen | None = None
        """The target when it was last visible."""
        self.heading = 0.0
        """Walking direction of the target [rad]."""
        self._filter: ConstantVelocity | None = None

    def goal(self, view: View) -> Pose2D:
        """Return the goal pose; it is the robot's pose until the target is first visible."""
        robot, target = view.robot, view.target
        if target is not None:
            if math.hypot(target.vx, target.vy) >= STANDING_M_S:
                self.heading = math.atan2(target.vy, target.vx)
            self.last = target
            return place(target, self.heading, robot, view.place, view.distance)
        if self.last is None:
            return robot
        if self._filter is None:
            self._filter = ConstantVelocity(self.last)
        self._filter.step(self.last)
        return place(self._filter.ahead(AHEAD_S), self.heading, robot, "back", SEARCH_M)
