"""One tick of following: estimate the person, place the goal, compute the command."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from mecazen.config import FollowerConfig, SensorConfig
from mecazen.config.follower import PidControl, PolarControl
from mecazen.drive import Drive
from mecazen.geometry import Pose2D, StandoffErrors, Twist2D, rotate, wrap
from mecazen.messages import LaserScan

from mecazen_follower.control import (
    ALL_AROUND,
    HEADING_BRAKING_RAD_S2,
    LINEAR_BRAKING_M_S2,
    FieldOfView,
    PolarController,
    PoseController,
    approach,
)
from mecazen_follower.estimators import Estimate
from mecazen_follower.planner.costs import Plan
from mecazen_follower.planner.mppi import Planner
from mecazen_follower.search import Look, Search
from mecazen_follower.tracker import Frame, PersonTracker, TrackingState

HARDLY_WALKS_M_S, UNKNOWN_RAD = 0.2, math.radians(25.0)
"""Speed and standard deviation of the heading: slower than the first, with the heading less certain
than the second, a person has no direction that the robot could go round them for. It waits."""

SEARCH = 1.0
"""Yaw rate at which a robot without an all-around view searches for a lost person [rad/s]."""
NEAR_M = 0.3
"""A place that is nearer has no direction [m]."""
SEARCH_GAIN_1_S, SEARCH_M_S, SEARCH_RAD_S = 2.0, 1.0, 2.0
"""Gain of the way, and greatest speeds [m/s, rad/s], of a robot that searches."""


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
    """The decision of the planner, or of the search for a lost person; None without either."""


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
        begin_search: Callable[[Estimate], Search] | None = None,
    ) -> None:
        self.people = PersonTracker(config, sensor, hold)
        self._controller: PoseController | PolarController
        if isinstance(config.control, PidControl):
            self._controller = PoseController(config.control)
        else:
            self._controller = PolarController(config.standoff, config.control, drive, view)
        self.planner = planner
        self._begin_search = begin_search
        self._stop_search()
        self._sight: Estimate | None = None
        """The person when last seen."""
        self.configure(config, drive, view)
        self._side = 1.0
        self._pending: deque[tuple[Twist2D, float]] = deque()
        """Commands to which the robot has not responded yet, with their durations [s]."""

    def configure(self, config: FollowerConfig, drive: Drive, view: FieldOfView) -> None:
        """Continue with changed gains, limits or standoff."""
        self._standoff, self._response, self._view = config.standoff, config.response_s, view
        self._drive, self._search_s = drive, config.search_s
        self._law = config.control if isinstance(config.control, PolarControl) else PolarControl()
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
        self._stop_search()
        self._sight = None
        self._controller.stop()
        if self.planner is not None:
            self.planner.forget()

    def step(self, time: float, dt: float, robot: Pose2D, frame: Frame | None) -> Step:
        """Compute the tick at `time` [s], `dt` [s] after the last one; base_link is at `robot`."""
        person = self.people.step(time, frame, self._standoff.person(robot))
        tracking, unseen = self.people.state, self.people.unseen
        if person is None:
            return Step(self._send(self._controller.stop(), dt), tracking, 0.0)
        lost, plan = tracking is TrackingState.LOST, None
        if lost:
            command, plan = self._search(unseen, robot, dt)
            if plan is not None and plan.state == "searching":
                tracking = TrackingState.SEARCHING
        else:
            self._stop_search()
            if tracking is TrackingState.FOLLOWING:
                self._sight = person
            command = self._follow(time, person, robot, dt)
            seen = robot.between(person.pose)
            self._side = rotate(seen.x, seen.y, -self._view.centre)[1]
            plan = None if self.planner is None else self.planner.plan
        goal = self._standoff.goal(person.pose)
        errors = self._standoff.errors(person.pose, robot)
        return Step(self._send(command, dt), tracking, unseen, person, goal, errors, plan)

    def _stop_search(self) -> None:
        self._searching: Search | None = None
        self._look: Look | None = None
        self._sent = Twist2D()

    def see(self, time: float, scan: LaserScan, robot: Pose2D, lidar: Pose2D) -> None:
        """Update planner and search with a scan captured at `time` [s] from poses in odom."""
        if self.planner is not None:
            self.planner.see(time, scan, lidar)
        if self._searching is not None:
            self._searching.see(scan, lidar, robot)
            self._look = self._searching.look(robot, self.people.strangers)

    def _search(self, unseen: float, robot: Pose2D, dt: float) -> tuple[Twist2D, Plan | None]:
        """Return the command for a person who is lost: drive and look, or turn, or stand."""
        twist = self._controller.stop()
        if self.planner is not None:
            self.planner.clear_plan()
        plan = None
        if self._begin_search is not None and self._sight is not None:
            if self._searching is None:
                self._searching = self._begin_search(self._sight)
                self._look = Look(robot[:2], self._sight.pose[:2], "where the person was last seen")
                self.people.begin_search()
            look = self._look if unseen < self._search_s else None
            if look is not None:
                return self._towards(look, robot, dt), Plan("searching", look.reason)
            plan = Plan("waiting", "the person was not found again")
        if self._view == ALL_AROUND:
            return twist, plan
        return twist._replace(yaw=math.copysign(SEARCH, self._side)), plan

    def _towards(self, look: Look, robot: Pose2D, dt: float) -> Twist2D:
        """Return the command on the way to a look, with the camera turned to its place."""
        dx, dy = look.way[0] - robot.x, look.way[1] - robot.y
        distance = max(math.hypot(dx, dy), 1e-6)
        speed = min(SEARCH_M_S, approach(distance, SEARCH_GAIN_1_S, LINEAR_BRAKING_M_S2))
        x, y = rotate(dx / distance * speed, dy / distance * speed, -robot.yaw)
        yaw = 0.0
        to_x, to_y = look.place[0] - robot.x, look.place[1] - robot.y
        if math.hypot(to_x, to_y) > NEAR_M:
            off = wrap(math.atan2(to_y, to_x) - robot.yaw - self._view.centre)
            yaw = approach(off, self._law.heading_gain_1_s, HEADING_BRAKING_RAD_S2)
            yaw = min(max(yaw, -SEARCH_RAD_S), SEARCH_RAD_S)
        self._sent = self._drive.step(self._sent, Twist2D(x, y, yaw), self._law.max_speed_m_s, dt)
        self._controller.resume(self._sent)
        return self._sent

    def _follow(self, time: float, person: Estimate, robot: Pose2D, dt: float) -> Twist2D:
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
