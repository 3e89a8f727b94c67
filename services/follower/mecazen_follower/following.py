"""One tick of following: estimate the person, place the goal, compute the command."""

from __future__ import annotations

import math
from collections import deque
from enum import StrEnum
from typing import NamedTuple

from mecazen.covariance import PlanarCovariance
from mecazen.drive import Drive
from mecazen.geometry import Pose2D, Twist2D, wrap

from mecazen_follower.config import FollowerConfig
from mecazen_follower.estimators import Estimate
from mecazen_follower.goal import Errors
from mecazen_follower.polar import UNLIMITED

MAX_STEP = 0.5
"""A pose that changes by more than this [m, rad] in a tick ..."""
MAX_SPEED = 10.0
"""... and faster than this [m/s, rad/s] has jumped: somebody has set the odometry."""

SEARCH = 1.0
"""Yaw rate at which a robot that does not see all around looks for a lost person [rad/s]."""


class TrackingState(StrEnum):
    """How well the follower knows where the person is."""

    WAITING = "waiting"
    """Not seen yet; the robot stands."""
    FOLLOWING = "following"
    """Seen."""
    COASTING = "coasting"
    """Not seen at the moment; the robot follows the prediction."""
    LOST = "lost"
    """Not seen for too long; the robot stops, and turns if it does not see all around."""


class Tracker:
    """Derives the tracking state from the time since the person was last seen.

    `coast_after` [s] is at least the time between two frames of the sensor, so that ticks
    between frames do not count as unseen; `lost_after` [s] is longer.

    Attributes:
        state: The state at the last update.
        unseen: Time since the person was last seen [s]; 0 before that.
    """

    def __init__(self, coast_after: float, lost_after: float) -> None:
        self.state = TrackingState.WAITING
        self.unseen = 0.0
        self._coast_after = coast_after
        self._lost_after = lost_after
        self._last_seen: float | None = None

    def update(self, time: float, seen: bool) -> TrackingState:
        """Return the state at simulated `time` [s]; `seen`: an observation came just now."""
        if seen:
            self._last_seen = time
        if self._last_seen is not None:
            self.unseen = time - self._last_seen
            if self.unseen > self._lost_after:
                self.state = TrackingState.LOST
            elif self.unseen > self._coast_after:
                self.state = TrackingState.COASTING
            else:
                self.state = TrackingState.FOLLOWING
        return self.state


class Measurement(NamedTuple):
    """An observed pose of the person in odom, and its 3x3 covariance of (x, y, yaw)."""

    pose: Pose2D
    covariance: PlanarCovariance


class Step(NamedTuple):
    """Result of one tick; poses and the person's velocity in odom, the command in base_link.

    Until the person is first seen, `person` is None, and `goal` and `errors` are meaningless.
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

    `latency` [s] is the time from the capture of a frame to its arrival; the estimate is
    propagated by it.
    """

    def __init__(
        self,
        config: FollowerConfig,
        latency: float,
        drive: Drive = UNLIMITED,
        view: float = math.inf,
    ) -> None:
        self.estimator = config.make_estimator()
        self._controller = config.make_controller(drive, view)
        self._sees_all = math.isinf(view)
        self._side = 1.0
        self._tracker = Tracker(config.coast_after_s, config.lost_after_s)
        self._standoff = config.standoff
        self._latency = latency
        self._response = config.response_s
        self._pending: deque[tuple[Twist2D, float]] = deque()
        """Commands to which the robot has not responded yet, with their durations [s]."""
        self._robot: Pose2D | None = None

    def step(self, time: float, dt: float, robot: Pose2D, measurement: Measurement | None) -> Step:
        """Compute the tick at `time` [s], `dt` [s] after the last, with base_link at `robot`.

        Raises:
            ValueError: The measurement is invalid, see `Estimator.update`. The call may be
                repeated without it.
        """
        if self._robot is not None and _jumped(self._robot, robot, dt):
            self.estimator.reset()
            self._controller.stop()
        if measurement is not None:
            if self._tracker.state is TrackingState.LOST:
                # the last known position is no prior for where the person reappears
                self.estimator.reset()
            self.estimator.update(*measurement)
        self._robot = robot
        tracking = self._tracker.update(time, seen=measurement is not None)
        person = self.estimator.ahead(self._latency)
        if person is None:
            return Step(self._send(self._controller.stop(), dt), tracking, 0.0)
        lost = tracking is TrackingState.LOST
        command = self._search() if lost else self._drive(person, robot, dt)
        if not lost:
            self._side = robot.between(person.pose).y
        goal = self._standoff.goal(person.pose)
        errors = self._standoff.errors(person.pose, robot)
        return Step(self._send(command, dt), tracking, self._tracker.unseen, person, goal, errors)

    def _search(self) -> Twist2D:
        """Return rest, or a turn to the side on which the person left the field of view."""
        twist = self._controller.stop()
        return twist if self._sees_all else twist._replace(yaw=math.copysign(SEARCH, self._side))

    def _drive(self, person: Estimate, robot: Pose2D, dt: float) -> Twist2D:
        """Return the command for the time at which the robot responds to it.

        Until then the person walks on, and the robot executes the pending commands.
        """
        person = person.after(self._response)
        for command, duration in self._pending:
            robot = robot.integrate(command, duration)
        goal = self._standoff.goal(person.pose)
        velocity = self._standoff.goal_velocity(person.pose, person.velocity)
        return self._controller.command(goal, velocity, robot, dt)

    def _send(self, command: Twist2D, dt: float) -> Twist2D:
        """Return `command`, noted as pending for `dt` [s]."""
        if self._response == 0.0:
            return command
        self._pending.append((command, dt))
        while sum(duration for _, duration in self._pending) > self._response + dt / 2:
            self._pending.popleft()
        return command


def _jumped(last: Pose2D, robot: Pose2D, dt: float) -> bool:
    limit = max(MAX_STEP, MAX_SPEED * dt)
    return last.distance(robot) > limit or abs(wrap(robot.yaw - last.yaw)) > limit
