"""Drives the robot around the person: decoupled control of distance, bearing and heading."""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen.config.follower import PolarControl
from mecazen.drive import Drive
from mecazen.geometry import Pose2D, Standoff, Twist2D, rotate, wrap

from mecazen_follower.allocation import Wanted, allocate

UNLIMITED = Drive()
HEADROOM = 0.2
"""Share of the wheel speed to keep in reserve; if following uses it, the robot turns to the
person."""

LINEAR_BRAKING_M_S2, HEADING_BRAKING_RAD_S2 = 2.0, 6.0
"""Decelerations that the robot can achieve."""
MARGIN = math.radians(15.0)
"""Angle between the kept view of the person and the edge of the field of view [rad]."""


def approach(error: float, gain: float, deceleration: float) -> float:
    """Return the rate at which to reduce `error`: proportional, with a `gain` [1/s].

    The rate is limited to √(2 a e), the speed from which the deceleration a stops within e.
    """
    size = abs(error)
    return math.copysign(min(gain * size, math.sqrt(2.0 * deceleration * size)), error)


class FieldOfView(NamedTuple):
    """Where to keep the person: within `half` of the direction `centre` in base_link [rad]."""

    half: float = math.inf
    centre: float = 0.0


ALL_AROUND = FieldOfView()


def kept_view(fov: float, centre: float = 0.0) -> FieldOfView:
    """Return the view in which to keep the person, for a field of view `fov` about `centre` [rad].

    The result leaves a margin to the edge of the field of view. The robot turns when the person
    enters this margin.
    """
    return ALL_AROUND if fov >= math.tau else FieldOfView(max(fov / 2 - MARGIN, fov / 4), centre)


class PolarController:
    """A control law in polar coordinates around the person.

    Feed-forward moves the robot like a body fixed to the person. Feedback corrects the distance
    along the line to the person, the bearing across it, and the heading: docs/following.md.

    The bearing error is an arc length [m]. `drive` contains the limits of the robot, and `view` the
    field of view in which to keep the person.
    """

    def __init__(
        self,
        standoff: Standoff,
        law: PolarControl,
        drive: Drive = UNLIMITED,
        view: FieldOfView = ALL_AROUND,
    ) -> None:
        self.configure(standoff, law, drive, view)
        self._last = Twist2D()

    def configure(
        self, standoff: Standoff, law: PolarControl, drive: Drive, view: FieldOfView
    ) -> None:
        """Continue with changed gains, limits or standoff."""
        self._standoff, self._law, self._drive, self._view = standoff, law, drive, view

    def command(self, goal: Pose2D, goal_velocity: Twist2D, robot: Pose2D, dt: float) -> Twist2D:
        """Return the twist in base_link that keeps the robot with the goal.

        `goal`, `goal_velocity` and `robot` are in odom; `dt` [s] is the time since the last call.
        """
        law, person = self._law, self._standoff.person(goal)
        turn = goal_velocity.yaw
        reach = goal.x - person.x, goal.y - person.y
        with_person = goal_velocity.x + turn * reach[1], goal_velocity.y - turn * reach[0]

        offset = robot.x - person.x, robot.y - person.y
        distance = math.hypot(*offset)
        wanted = math.atan2(reach[1], reach[0])
        bearing = math.atan2(offset[1], offset[0]) if distance > 0.0 else wanted
        direction = bearing - robot.yaw  # in base_link

        away, around = rotate(*with_person, -bearing)
        # direction of the person, relative to the goal's heading
        centre = self._view.centre
        off = wrap(bearing + math.pi - goal.yaw - centre) + centre
        facing = self._facing(rotate(*with_person, -goal.yaw), off)
        if abs(off - facing - centre) >= self._view.half and distance > 0.0:
            # at the edge of the view, the heading follows the person
            turn_to_person = rotate(self._last.x, self._last.y, -direction)[1] - around
            feed_forward = turn_to_person / distance
        else:
            feed_forward = turn
        error = wrap(goal.yaw + facing - robot.yaw)
        yaw = feed_forward + approach(error, law.heading_gain_1_s, HEADING_BRAKING_RAD_S2)

        linear = law.linear_gain_1_s, LINEAR_BRAKING_M_S2
        away += approach(self._standoff.distance - distance, *linear)
        around += distance * turn + approach(distance * wrap(wanted - bearing), *linear)
        yaw = min(max(yaw, -law.max_yaw_rate_rad_s), law.max_yaw_rate_rad_s)
        twist = Wanted(away, around, yaw, turn_first=facing != 0.0)
        self._last = allocate(twist, direction, self._last, self._drive, law.max_speed_m_s, dt)
        return self._last

    def _facing(self, velocity: tuple[float, float], off: float) -> float:
        """Return how far to turn from the heading of the goal towards the person [rad].

        If the robot faces the person, it reaches its full speed along the line to the person, and
        the bearing yields until the robot is fast enough. So the robot turns the more, the nearer
        the person's `velocity`, along the axes of the goal, takes the wheels to their limit. The
        robot also turns until the person is in view. `off` is the person's direction from the
        goal's heading [rad].
        """
        x, y = velocity
        used = (abs(x) + self._drive.sideways * abs(y)) / self._drive.rim_speed
        facing = off * min(max((used - 1.0) / HEADROOM + 1.0, 0.0), 1.0)
        half, centre = self._view
        return off - min(max(off - facing, centre - half), centre + half)

    def resume(self, twist: Twist2D) -> None:
        """Continue from a twist in base_link that was commanded instead of the last output."""
        self._last = twist

    def stop(self) -> Twist2D:
        """Return the zero twist."""
        self._last = Twist2D()
        return self._last
