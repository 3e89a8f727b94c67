"""Drives the robot around the person: distance, bearing and heading, each by itself."""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen.geometry import Pose2D, Twist2D, rotate, wrap

from mecazen_follower.goal import Standoff


class Approach(NamedTuple):
    """How an error is taken back: at `gain` [1/s] near 0, and braking in time from afar.

    `deceleration` [m/s² or rad/s²] is what the robot can brake with.
    """

    gain: float
    deceleration: float

    def rate(self, error: float) -> float:
        """Return the rate at which to reduce `error`, with its sign.

        Braking steadily, v² = 2 a e: faster than that it would be passed.
        """
        size = abs(error)
        braking = math.sqrt(2.0 * self.deceleration * size)
        return math.copysign(min(self.gain * size, braking), error)


class PolarController:
    """A control law in polar coordinates around the person.

    The robot moves with the person, as a body fixed to them would. To that is added what
    takes back the error of the distance, along the line to the person; of the bearing,
    across it; and of the heading. The way to a goal on the other side of the person so
    leads around them, where three PIDs along x, y and yaw would lead through.

    Each axis of base_link is limited by itself. A robot that faces the person has the
    distance on x and the bearing on y: a person who turns on the spot takes the goal around
    with 1 m/s for each rad/s, and the distance does not suffer where that is too fast.

    `linear` is the approach of distance and bearing, the latter as a length of arc [m];
    `heading` that of the heading. `max_speed` [m/s] holds for x and for y of base_link.
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

        `goal`, `goal_velocity` and `robot` are in odom; the law has no memory, and `dt` is
        not used.
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
        to_place_x, to_place_y = rotate(out, around, bearing - robot.yaw)
        yaw = turn + self._heading.rate(wrap(goal.yaw - robot.yaw))
        return Twist2D(
            _limited(x + to_place_x, self._max_speed),
            _limited(y + to_place_y, self._max_speed),
            _limited(yaw, self._max_yaw_rate),
        )

    def stop(self) -> Twist2D:
        """Return the twist at rest: nobody is to be followed."""
        return Twist2D()


def _limited(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
