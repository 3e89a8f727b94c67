"""Drives the robot to a goal pose that moves: one PID per axis of base_link."""

from __future__ import annotations

from mecazen.geometry import Pose2D, Twist2D, rotate

from mecazen_follower.pid import PID, Gains


class PoseController:
    """PIDs for linear x, linear y and angular z, in base_link, on the goal's pose error.

    The derivative is on the measurement: the robot's own motion, never the goal's pose,
    which jumps with every observation. In base_link that motion is the body twist, taken
    here from two consecutive poses of the robot. It is not the derivative of the error as
    seen from base_link: that one also contains the apparent motion of the goal as the robot
    turns, which is no motion to damp.

    With feed-forward, the robot is expected to move with the goal: the goal's velocity is
    added to the output and subtracted from the measured rate, so that the derivative damps
    what deviates from it. Without, the derivative also opposes steady following, and the
    integral has to make up for it.

    Integrals are kept in base_link too, where what they make up for (slip, lag in a steady
    turn) stays constant.
    """

    def __init__(self, x: Gains, y: Gains, yaw: Gains, feed_forward: bool) -> None:
        self._x, self._y, self._yaw = PID(x), PID(y), PID(yaw)
        self._feed_forward = feed_forward
        self._last: Pose2D | None = None

    def command(self, goal: Pose2D, goal_velocity: Twist2D, robot: Pose2D, dt: float) -> Twist2D:
        """Return the twist in base_link that brings the robot to the goal.

        `goal`, `goal_velocity` and `robot` are in odom; `dt` [s] is the time since the last
        call.
        """
        error = robot.between(goal)
        expected = Twist2D()
        if self._feed_forward:
            x, y = rotate(goal_velocity.x, goal_velocity.y, -robot.yaw)
            expected = Twist2D(x, y, goal_velocity.yaw)
        # At the first call the motion is not known yet: nothing to damp.
        measured = expected
        if self._last is not None:
            moved = self._last.between(robot)
            measured = Twist2D(moved.x / dt, moved.y / dt, moved.yaw / dt)
        self._last = robot
        return Twist2D(
            self._x.update(error.x, measured.x - expected.x, dt, expected.x),
            self._y.update(error.y, measured.y - expected.y, dt, expected.y),
            self._yaw.update(error.yaw, measured.yaw - expected.yaw, dt, expected.yaw),
        )

    def stop(self) -> Twist2D:
        """Forget everything and return the twist at rest: nobody is to be followed."""
        for pid in (self._x, self._y, self._yaw):
            pid.reset()
        self._last = None
        return Twist2D()
