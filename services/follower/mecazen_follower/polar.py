"""Drives the robot around the person: decoupled control of distance, bearing and heading."""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen.geometry import Pose2D, Twist2D, rotate, wrap

from mecazen_follower.goal import Standoff


class Approach(NamedTuple):
    """A proportional `gain` [1/s], limited so that the robot can brake in time.

    `deceleration` [m/s² or rad/s²] is what the robot can achieve.
    """

    gain: float
    deceleration: float

    def rate(self, error: float) -> float:
        """Return the rate at which to reduce `error`, with its sign.

        It is limited to √(2 a e), the speed from which the deceleration a stops within e.
        """
        size = abs(error)
        braking = math.sqrt(2.0 * self.deceleration * size)
        return math.copysign(min(self.gain * size, braking), error)


class PolarController:
    """A control law in polar coordinates around the person.

    Feed-forward moves the robot like a body fixed to the person. Feedback corrects the distance
    along the line to the person, the bearing across it, and the heading: docs/following.md.

    `linear` is the approach of distance and bearing, the latter as an arc length [m];
    `heading` is that of the heading. `max_speed` [m/s] limits base_link in any direction.
    """

    def __init__(
        self,
        standoff: Standoff,
        linear: Approach,
        heading: Approach,
        max_speed: float,
        max_yaw_rate: float,
    ) -> None:
        self._standoff = standoff
        self._linear, self._heading = linear, heading
        self._max_speed, self._max_yaw_rate = max_speed, max_yaw_rate

    def command(self, goal: Pose2D, goal_velocity: Twist2D, robot: Pose2D, dt: float) -> Twist2D:
        """Return the twist in base_link that keeps the robot with the goal.

        `goal`, `goal_velocity` and `robot` are in odom. The law has no state; `dt` is not used.
        """
        del dt
        person = self._standoff.person(goal)
        turn = goal_velocity.yaw
        reach = goal.x - person.x, goal.y - person.y
        with_person = goal_velocity.x + turn * reach[1], goal_velocity.y - turn * reach[0]

        away = robot.x - person.x, robot.y - person.y
        distance = math.hypot(*away)
        wanted = math.atan2(reach[1], reach[0])
        bearing = math.atan2(away[1], away[0]) if distance > 0.0 else wanted
        out = self._linear.rate(self._standoff.distance - distance)
        around = distance * turn + self._linear.rate(distance * wrap(wanted - bearing))

        x, y = rotate(*with_person, -robot.yaw)
        along = bearing - robot.yaw  # direction from the person to the robot, in base_link
        c, s = math.cos(along), math.sin(along)
        around_x, around_y = -s * around, c * around
        x, y = _within(x + c * out, y + s * out, self._max_speed)
        share = _share(x, y, around_x, around_y, self._max_speed)
        yaw = turn + self._heading.rate(wrap(goal.yaw - robot.yaw))
        return Twist2D(
            x + share * around_x,
            y + share * around_y,
            min(max(yaw, -self._max_yaw_rate), self._max_yaw_rate),
        )

    def stop(self) -> Twist2D:
        """Return the zero twist."""
        return Twist2D()


def _within(x: float, y: float, limit: float) -> tuple[float, float]:
    """Return a vector with its length limited to `limit`."""
    length = math.hypot(x, y)
    return (x, y) if length <= limit else (x * limit / length, y * limit / length)


def _share(x: float, y: float, more_x: float, more_y: float, limit: float) -> float:
    """Return the largest s from 0 to 1 with |(x, y) + s·more| <= limit, where |(x, y)| is."""
    a, b = more_x**2 + more_y**2, x * more_x + y * more_y
    c = max(limit**2 - x**2 - y**2, 0.0)
    if a + 2.0 * b <= c:
        return 1.0
    # the root of a s² + 2 b s - c, in the form without cancellation
    root = math.sqrt(b * b + a * c)
    return c / (b + root) if b > 0.0 else (root - b) / a
