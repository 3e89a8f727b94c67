"""One tick of following: estimate the person, place the goal, compute the command."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from mecazen.config import FollowerConfig, SensorConfig
from mecazen.config.follower import PidControl
from mecazen.drive import Drive
from mecazen.geometry import Pose2D, StandoffErrors, Twist2D, rotate, wrap

from mecazen_follower.control import (
    ALL_AROUND,
    FieldOfView,
    PolarController,
    PoseController,
)
from mecazen_follower.estimators import Estimate
from mecazen_follower.planner.costs import Plan
from mecazen_follower.planner.mppi import Planner
from mecazen_follower.tracker import Frame, PersonTracker, TrackingState

HARDLY_WALKS_M_S, UNKNOWN_RAD = 0.2, math.radians(25.0)
"""Speed and standard deviation of the heading: slower than the first, with the heading less certain
than the second, a person has no direction that the robot could go round them for. It waits."""

SEARCH = 1.0
"""Yaw rate at which a robot without an all-around view searches for a lost person [rad/s]."""


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
    errors: StandoffErrors = StandoffErrors(0.0, 0.0, 0.0)
    plan: Plan | None = None
    """The planner's decision while the robot follows; None without a planner."""


class Following:
    """Keeps the robot at its goal beside the person, who is observed by the given sensor."""

    def __init__(
        self,
        config: FollowerConfig,
        sensor: SensorConfig,
        drive: Drive,
        view: FieldOfView = ALL_AROUND,
        hold: float = 0.0,
        planner: Planner | None = None,
    ) -> None:
        self.people = PersonTracker(config, sensor, hold)
        self._controller: PoseController | PolarController
        if isinstance(config.control, PidControl):
            self._controller = PoseController(config.control)
        else:
            self._controller = PolarController(config.standoff, config.control, drive, view)
        self.planner = planner
        self.configure(config, drive, view)
        self._side = 1.0
        self._pending: deque[tuple[Twist2D, float]] = deque()
        """Commands to which the robot has not responded yet, with their durations [s]."""

    def configure(self, config: FollowerConfig, drive: Drive, view: FieldOfView) -> None:
        """Continue with changed gains, limits or standoff."""
        self._standoff, self._response, self._view = config.standoff, config.response_s, view
        if isinstance(config.control, PidControl):
            assert isinstance(self._controller, PoseController)  # its kind can't change
            self._controller.configure(config.control)
        else:
            assert isinstance(self._controller, PolarController)
            self._controller.configure(config.standoff, config.control, drive, view)
        if self.planner is not None:
            self.planner.configure(config, drive)

    def forget(self) -> None:
        """Forget everything that has a place in odom, since odom has changed."""
        self.people.forget()
        self._controller.stop()
        if self.planner is not None:
            self.planner.forget()

    def step(self, time: float, dt: float, robot: Pose2D, frame: Frame | None) -> Step:
        """Compute the tick at `time` [s], `dt` [s] after the last one; base_link is at `robot`."""
        person = self.people.step(time, frame, self._standoff.person(robot))
        tracking, unseen = self.people.state, self.people.unseen
        if person is None:
            return Step(self._send(self._controller.stop(), dt), tracking, 0.0)
        lost = tracking is TrackingState.LOST
        command = self._search() if lost else self._drive(time, person, robot, dt)
        if not lost:
            seen = robot.between(person.pose)
            self._side = rotate(seen.x, seen.y, -self._view.centre)[1]
        goal = self._standoff.goal(person.pose)
        errors = self._standoff.errors(person.pose, robot)
        plan = None if lost or self.planner is None else self.planner.plan
        return Step(self._send(command, dt), tracking, unseen, person, goal, errors, plan)

    def _search(self) -> Twist2D:
        """Return the zero twist, or a turn to the side on which the person left the view."""
        twist = self._controller.stop()
        if self.planner is not None:
            self.planner.clear_plan()
        if self._view == ALL_AROUND:
            return twist
        return twist._replace(yaw=math.copysign(SEARCH, self._side))

    def _drive(self, time: float, person: Estimate, robot: Pose2D, dt: float) -> Twist2D:
        """Return the command for the time at which the robot responds to it.

        Until then the person walks on, and the robot executes the pending commands.
        """
        person = person.after(self._response)
        for command, duration in self._pending:
            robot = robot.integrate(command, duration)
        if isinstance(self._controller, PolarController):  # the published law has no such rule
            person = self._heading_held(person, robot)
        goal = self._standoff.goal(person.pose)
        velocity = self._standoff.goal_velocity(person.pose, person.velocity)
        command = self._controller.command(goal, velocity, robot, dt)
        if self.planner is None:
            return command
        planned = self.planner.command(time + self._response, dt, person, robot, command)
        if planned is not command:
            self._controller.resume(planned)
        return planned

    def _heading_held(self, person: Estimate, robot: Pose2D) -> Estimate:
        """Return the person, with an unknown heading as that for which the robot stands right.

        The robot then keeps its distance, and does not go round a person who hardly walks.
        """
        speed = math.hypot(person.velocity.x, person.velocity.y)
        if speed >= HARDLY_WALKS_M_S or math.sqrt(person.covariance[2][2]) <= UNKNOWN_RAD:
            return person
        x, y, _ = person.pose
        yaw = wrap(math.atan2(robot.y - y, robot.x - x) - self._standoff.bearing)
        velocity = person.velocity._replace(yaw=0.0)
        return person._replace(pose=Pose2D(x, y, yaw), velocity=velocity)

    def _send(self, command: Twist2D, dt: float) -> Twist2D:
        """Record `command` as pending for `dt` [s], and return it."""
        if self._response == 0.0:
            return command
        self._pending.append((command, dt))
        while math.fsum(duration for _, duration in self._pending) > self._response + dt / 2:
            self._pending.popleft()
        return command
