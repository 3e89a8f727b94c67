"""Where the robot should stand relative to the person, and the errors of its pose."""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen.geometry import Pose2D, Twist2D, rotate, wrap


class Errors(NamedTuple):
    """Errors of the distance [m], of the bearing around the person and of the heading [rad]."""

    distance: float
    bearing: float
    yaw: float


class Standoff(NamedTuple):
    """A place beside a person, in the person's own frame (x ahead, y to the left).

    `distance` [m] and `bearing` [rad] lead from the person to the robot; the bearing is 0 ahead and
    pi/2 to the left. `heading` is the robot's heading minus the person's [rad].
    """

    distance: float
    bearing: float
    heading: float

    def goal(self, person: Pose2D) -> Pose2D:
        """Return the pose that the robot should have, in the frame of `person`."""
        x = self.distance * math.cos(self.bearing)
        y = self.distance * math.sin(self.bearing)
        return person.compose(Pose2D(x, y, self.heading))

    def person(self, goal: Pose2D) -> Pose2D:
        """Return the person's pose for a goal pose; the inverse of `goal`."""
        yaw = wrap(goal.yaw - self.heading)
        x, y = rotate(self.distance, 0.0, yaw + self.bearing)
        return Pose2D(goal.x - x, goal.y - y, yaw)

    def goal_velocity(self, person: Pose2D, velocity: Twist2D) -> Twist2D:
        """Return the velocity of the goal, a point fixed to the person: v + ω × r.

        `velocity` and the result are along the axes of the frame of `person`.
        """
        x, y = rotate(self.distance, 0.0, person.yaw + self.bearing)
        return Twist2D(velocity.x - velocity.yaw * y, velocity.y + velocity.yaw * x, velocity.yaw)

    def errors(self, person: Pose2D, robot: Pose2D) -> Errors:
        """Return actual minus desired distance, bearing and heading of `robot`."""
        seen = person.between(robot)
        return Errors(
            math.hypot(seen.x, seen.y) - self.distance,
            wrap(math.atan2(seen.y, seen.x) - self.bearing),
            wrap(seen.yaw - self.heading),
        )
