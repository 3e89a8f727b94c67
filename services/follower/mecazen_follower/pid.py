"""Drives the robot to a moving goal pose: one PID per axis of base_link."""

from __future__ import annotations

from mecazen.config.follower import Gains, PidControl
from mecazen.geometry import Pose2D, Twist2D, rotate


class PID:
    """u = feed-forward + kp e + ki ∫e dt - kd dm/dt, limited, with anti-windup.

    The derivative acts on the measurement m and not on the error, so a step of the reference
    gives no kick. The caller passes the rate of m, so angles need no unwrapping here.

    Anti-windup by conditional integration: while the output is saturated, an error that would
    push it further is not integrated.
    """

    def __init__(self, gains: Gains) -> None:
        self.gains = gains
        self._integral = 0.0

    def update(self, error: float, rate: float, dt: float, feed_forward: float = 0.0) -> float:
        """Return the output for `error` = reference - measurement, after `dt` [s].

        `rate` is the derivative of the measurement; `feed_forward` has the unit of the output
        and counts towards its limit.
        """
        gains = self.gains
        integral = self._integral + gains.ki * error * dt
        output = feed_forward + gains.kp * error + integral - gains.kd * rate
        if abs(output) <= gains.limit or output * error < 0.0:
            self._integral = integral
        return min(max(output, -gains.limit), gains.limit)

    def reset(self) -> None:
        """Set the integral to zero."""
        self._integral = 0.0


class PoseController:
    """PIDs for linear x, linear y and angular z in base_link, on the error of the goal pose.

    The derivative acts on the robot's body twist, taken from two consecutive poses. The goal's
    pose, which jumps with every observation, does not affect it, nor does the goal's apparent
    motion in base_link when the robot turns.

    With feed-forward, the goal's velocity is added to the output and subtracted from the
    measured rate, so the derivative damps only deviations from it. Without feed-forward the
    derivative opposes steady following, and the integral has to compensate.

    Integrals are in base_link, where slip and the lag in a steady turn are constant.
    """

    def __init__(self, law: PidControl) -> None:
        self._x, self._y, self._yaw = PID(law.x), PID(law.y), PID(law.yaw)
        self._feed_forward = law.feed_forward
        self._last: Pose2D | None = None

    def configure(self, law: PidControl) -> None:
        """Continue with other gains."""
        self._x.gains, self._y.gains, self._yaw.gains = law.x, law.y, law.yaw
        self._feed_forward = law.feed_forward

    def command(self, goal: Pose2D, goal_velocity: Twist2D, robot: Pose2D, dt: float) -> Twist2D:
        """Return the twist in base_link that drives the robot to the goal.

        `goal`, `goal_velocity` and `robot` are in odom; `dt` [s] is the time since the last
        call.
        """
        error = robot.between(goal)
        expected = Twist2D()
        if self._feed_forward:
            x, y = rotate(goal_velocity.x, goal_velocity.y, -robot.yaw)
            expected = Twist2D(x, y, goal_velocity.yaw)
        # at the first call the twist is unknown: no damping
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

    def resume(self, twist: Twist2D) -> None:
        """Reset the controller: its integrals do not match the twist that was commanded instead."""
        del twist
        self.stop()

    def stop(self) -> Twist2D:
        """Reset the controller and return the zero twist."""
        for pid in (self._x, self._y, self._yaw):
            pid.reset()
        self._last = None
        return Twist2D()
