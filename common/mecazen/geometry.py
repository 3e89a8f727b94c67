"""Planar geometry: poses, twists, places beside a person. SI units, x forward, y left (REP-103)."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from mecazen.errors import RefusedError

JUMP = 0.5
"""The least change of a pose that counts as a jump [m, rad]."""
MAX_SPEED = 10.0
"""Speed above which a change of a pose counts as a jump [m/s, rad/s]: no robot is as fast."""


def wrap(angle: float) -> float:
    """Return `angle` [rad] brought into (-pi, pi].

    >>> wrap(1.5 * math.pi) == -0.5 * math.pi
    True
    """
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


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

    def compose(self, pose: Pose2D) -> Pose2D:
        """Transform a pose from this frame into this frame's parent.

        >>> Pose2D(2.0, 1.0, 0.0).compose(Pose2D(0.5, 0.25, 1.0))
        Pose2D(x=2.5, y=1.25, yaw=1.0)
        """
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2D(
            self.x + c * pose.x - s * pose.y,
            self.y + s * pose.x + c * pose.y,
            wrap(self.yaw + pose.yaw),
        )

    def between(self, pose: Pose2D) -> Pose2D:
        """Transform a pose from this frame's parent into this frame.

        >>> Pose2D(2.0, 1.0, 0.0).between(Pose2D(2.5, 1.25, 1.0))
        Pose2D(x=0.5, y=0.25, yaw=1.0)
        """
        x, y = rotate(pose.x - self.x, pose.y - self.y, -self.yaw)
        return Pose2D(x, y, wrap(pose.yaw - self.yaw))

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
        return self.compose(Pose2D(sinc * dx - cosc * dy, cosc * dx + sinc * dy, a))

    def distance(self, pose: Pose2D) -> float:
        """Return the distance between the two origins [m]."""
        return math.hypot(pose.x - self.x, pose.y - self.y)


def rotate(x: float, y: float, yaw: float) -> tuple[float, float]:
    """Return the vector (x, y) turned by `yaw` [rad]."""
    c, s = math.cos(yaw), math.sin(yaw)
    return c * x - s * y, s * x + c * y


def jumped(last: Pose2D, pose: Pose2D, dt: float) -> bool:
    """Return whether a robot can't have moved from one pose to the next in `dt` [s].

    Then the odometry was set or restarted, and places in odom from before are elsewhere now.

    >>> jumped(Pose2D(), Pose2D(1.0), 0.01), jumped(Pose2D(), Pose2D(1.0), 0.2)
    (True, False)
    """
    limit = max(JUMP, MAX_SPEED * dt)
    return last.distance(pose) > limit or abs(wrap(pose.yaw - last.yaw)) > limit


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


class StandoffErrors(NamedTuple):
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

    def errors(self, person: Pose2D, robot: Pose2D) -> StandoffErrors:
        """Return actual minus desired distance, bearing and heading of `robot`."""
        seen = person.between(robot)
        return StandoffErrors(
            math.hypot(seen.x, seen.y) - self.distance,
            wrap(math.atan2(seen.y, seen.x) - self.bearing),
            wrap(seen.yaw - self.heading),
        )


class PoseHistory:
    """The newest poses of a moving body, kept for `duration_ns` of simulated time."""

    def __init__(self, duration_ns: int) -> None:
        self._duration_ns = duration_ns
        self._poses: deque[tuple[int, Pose2D]] = deque()

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def span_ns(self) -> tuple[int, int]:
        """The times of the oldest and the newest of at least one pose [ns]."""
        return self._poses[0][0], self._poses[-1][0]

    def add(self, time_ns: int, pose: Pose2D) -> None:
        """Add a pose that is newer than all poses before."""
        self._poses.append((time_ns, pose))
        while time_ns - self._poses[0][0] > self._duration_ns:
            self._poses.popleft()

    def at(self, time_ns: int) -> Pose2D:
        """Return the pose at a time, between two poses by linear interpolation.

        The yaw turns the shorter way. A known pose is returned unchanged. If the pose at time 0 is
        not known, time 0 means the newest pose, as in ROS's tf2.

        Raises:
            RefusedError: The time is before the oldest pose or after the newest.
        """
        poses = self._poses
        if not poses or not poses[0][0] <= time_ns <= poses[-1][0]:
            if poses and time_ns == 0:
                return poses[-1][1]
            known = f"{poses[0][0] / 1e9:g} to {poses[-1][0] / 1e9:g} s" if poses else "no time"
            raise RefusedError(f"no pose is known of {time_ns / 1e9:g} s, only of {known}")
        # most queries are for the newest ticks, and a deque is quick at its ends
        index = len(poses) - 1
        while index > 0 and poses[index - 1][0] >= time_ns:
            index -= 1
        after_ns, after = poses[index]
        if after_ns == time_ns:
            return after
        before_ns, before = poses[index - 1]
        share = (time_ns - before_ns) / (after_ns - before_ns)
        return Pose2D(
            before.x + share * (after.x - before.x),
            before.y + share * (after.y - before.y),
            wrap(before.yaw + share * wrap(after.yaw - before.yaw)),
        )
