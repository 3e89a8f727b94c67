"""Drives the robot to a moving goal pose: one PID per axis of base_link."""

from __future__ import annotations

from mecazen.config.follower import Gains, PidControl
from mecazen.geometry import Pose2D, Twist2D, rotate, wrap


class PID:
    """u = feed-forward + kp e + ki ∫e dt + kd de/dt, limited, with anti-windup.

    Without feed-forward, equation 3 of "A Virtual Mecanum Wheeled Robot ROS Simulator ...", which
    has no limit. The caller passes de/dt, so angles need no unwrapping here.

    Anti-windup by conditional integration: while the output is saturated, an error that would
    push it further is not integrated.
    """

    def __init__(self, gains: Gains) -> None:
        self.gains = gains
        self._integral = 0.0

    def update(self, error: float, rate: float, dt: float, feed_forward: float = 0.0) -> float:
        """Return the output for an error, `dt` [s] after the last one.

        `rate` is the derivative of the error; `feed_forward` has the unit of the output and counts
        towards its limit.
        """
        gains = self.gains
        integral = self._integral + gains.ki * error * dt
        output = feed_forward + gains.kp * error + integral + gains.kd * rate
        if abs(output) <= gains.limit or output * error < 0.0:
            self._integral = integral
        return min(max(output, -gains.limit), gains.limit)

    def reset(self) -> None:
        """Set the integral to zero."""
        self._integral = 0.0


class PoseController:
    """PIDs for linear x, linear y and angular z in base_link, on the error of the goal pose.

    The derivative is the change of this error since the last call. It includes the jump of the goal
    with every observation, and the goal's apparent motion in base_link when the robot turns.

    With feed-forward, the goal's velocity is added to the output.

    Integrals are in base_link, where slip and the lag in a steady turn are constant.
    """

    def __init__(self, law: PidControl) -> None:
        self._x, self._y, self._yaw = PID(law.x), PID(law.y), PID(law.yaw)
        self._feed_forward = law.feed_forward
        self._last: Pose2D | None = None
        """The last error."""

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
        # at the first call the derivative is unknown
        last = error if self._last is None else self._last
        self._last = error
        return Twist2D(
            self._x.update(error.x, (error.x - last.x) / dt, dt, expected.x),
            self._y.update(error.y, (error.y - last.y) / dt, dt, expected.y),
            self._yaw.update(error.yaw, wrap(error.yaw - last.yaw) / dt, dt, expected.yaw),
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
