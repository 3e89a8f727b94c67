"""One tick of following: estimate the person, place the goal, drive towards it."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from mecazen.covariance import PlanarCovariance
from mecazen.geometry import Pose2D, Twist2D, wrap

from mecazen_follower.config import FollowerConfig
from mecazen_follower.estimators import Estimate
from mecazen_follower.goal import Errors
from mecazen_follower.tracking import TrackingState

MAX_STEP = 0.5
"""Farther [m], or turned by more [rad], than this ..."""
MAX_SPEED = 10.0
"""... and than at this speed [m/s, rad/s], nothing moves: the odometry was set anew."""


class Measurement(NamedTuple):
    """An observed pose of the person in odom, and its 3x3 covariance of (x, y, yaw)."""

    pose: Pose2D
    covariance: PlanarCovariance


class Step(NamedTuple):
    """What one tick gave; poses and the person's velocity in odom, the command in base_link.

    Before the person was first seen there is no `person`, and `goal` and `errors` say nothing.
    """

    command: Twist2D
    tracking: TrackingState
    unseen: float
    """Time since the person was last seen [s]."""
    person: Estimate | None = None
    goal: Pose2D = Pose2D()
    errors: Errors = Errors(0.0, 0.0, 0.0)


class Following:
    """Keeps the robot at its place beside the person.

    `latency` [s] is the time from the capture of a frame to its arrival, by which the
    estimate is carried ahead.
    """

    def __init__(self, config: FollowerConfig, latency: float) -> None:
        self.estimator = config.make_estimator()
        self._controller = config.make_controller()
        self._tracker = config.make_tracker()
        self._standoff = config.standoff
        self._latency = latency
        self._response = config.response_s
        self._unanswered: deque[tuple[Twist2D, float]] = deque()
        self._tracking = TrackingState.WAITING
        self._robot: Pose2D | None = None
        self._last_seen = 0.0

    def step(self, time: float, dt: float, robot: Pose2D, measurement: Measurement | None) -> Step:
        """Go ahead by `dt` [s] to `time` [s], with base_link at `robot` in odom.

        Raises:
            ValueError: The measurement is no pose, see `Estimator.update`; without it the call
                may be made again.
        """
        if self._robot is not None and _jumped(self._robot, robot, dt):
            self.estimator.reset()
            self._controller.stop()
        if measurement is not None:
            if self._tracking is TrackingState.LOST:
                # where they were last is no prior any more for where they appear
                self.estimator.reset()
            self.estimator.update(*measurement)
            self._last_seen = time
        self._robot = robot
        self._tracking = self._tracker.update(time, seen=measurement is not None)
        person = self.estimator.ahead(self._latency)
        if person is None:
            return Step(self._sent(self._controller.stop(), dt), self._tracking, 0.0)
        lost = self._tracking is TrackingState.LOST
        command = (
            self._sent(self._controller.stop(), dt) if lost else self._drive(person, robot, dt)
        )
        goal = self._standoff.goal(person.pose)
        errors = self._standoff.errors(person.pose, robot)
        return Step(command, self._tracking, time - self._last_seen, person, goal, errors)

    def _drive(self, person: Estimate, robot: Pose2D, dt: float) -> Twist2D:
        """Return the command for when the wheels answer to it.

        Until then the person walks on, and the robot does what it was told before.
        """
        person = person.after(self._response)
        for command, duration in self._unanswered:
            robot = robot.integrate(command, duration)
        goal = self._standoff.goal(person.pose)
        velocity = self._standoff.goal_velocity(person.pose, person.velocity)
        return self._sent(self._controller.command(goal, velocity, robot, dt), dt)

    def _sent(self, command: Twist2D, dt: float) -> Twist2D:
        """Note that the robot is told `command` for `dt` [s]."""
        if self._response == 0.0:
            return command
        self._unanswered.append((command, dt))
        while sum(duration for _, duration in self._unanswered) > self._response + dt / 2:
            self._unanswered.popleft()
        return command

    def predict(self, dt: float) -> None:
        """Let the person move on for `dt` [s]."""
        self.estimator.predict(dt)


def _jumped(last: Pose2D, robot: Pose2D, dt: float) -> bool:
    most = max(MAX_STEP, MAX_SPEED * dt)
    return last.distance(robot) > most or abs(wrap(robot.yaw - last.yaw)) > most
