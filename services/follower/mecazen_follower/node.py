"""The follower: odometry and observations to cmd_vel."""

from __future__ import annotations

import logging
import math
from collections import deque
from itertools import repeat

from mecazen import messages as m
from mecazen.config import Scenario
from mecazen.config.follower import PidControl, PolarControl
from mecazen.drive import Drive
from mecazen.errors import ConfigError, RefusedError
from mecazen.geometry import Pose2D, PoseHistory, Twist2D, jumped, rotate, wrap
from mecazen.graph import SEARCHES
from mecazen.keys import CMD_VEL, FOLLOWER_STATE, LEGS, OBSERVATION, ODOM, SCAN, Topic
from mecazen.messages import planar_covariance, ros_covariance
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.scan import ranges_of
from mecazen.wire import NS_PER_S
from msgspec.structs import replace

from mecazen_follower.control import (
    HEADING_BRAKING_RAD_S2,
    LINEAR_BRAKING_M_S2,
    PolarController,
    PoseController,
    approach,
)
from mecazen_follower.estimators import Estimate
from mecazen_follower.measurement import Frame, Measurement, check, rotated
from mecazen_follower.planner.costs import Extents, Plan
from mecazen_follower.planner.mppi import Planner
from mecazen_follower.search import Look, Search
from mecazen_follower.sight import ALL_AROUND, sight_of, view_of
from mecazen_follower.tracker import PersonTracker, TrackingState

logger = logging.getLogger(__name__)

HISTORY_S = 5.0
"""Time beyond the sensor's latency for which odometry is kept for late observations [s]."""

CLEARANCE_M = 0.1
"""Minimum gap between person and robot, for the error of following [m]."""
SHORTLY_UNSEEN = (TrackingState.WAITING, TrackingState.FOLLOWING, TrackingState.COASTING)
"""The states before the person is lost."""

HARDLY_WALKS_M_S, UNKNOWN_RAD = 0.2, math.radians(25.0)
"""Speed and standard deviation of the heading: slower than the first, with the heading less certain
than the second, a person has no direction that the robot could go round them for. It waits."""

TURN_RAD_S = 1.0
"""Yaw rate at which a robot without an all-around view looks for a lost person [rad/s]."""
NEAR_M = 0.3
"""A place that is nearer has no direction [m]."""
SEARCH_GAIN_1_S, SEARCH_M_S, SEARCH_RAD_S = 2.0, 1.0, 2.0
"""Gain of the way, and greatest speeds [m/s, rad/s], of a robot that searches."""


class FollowerNode(Node):
    """Estimates the person from noisy observations and drives the robot to its goal.

    An observation is transformed with the robot's pose at its capture, even if it arrives late.

    Raises:
        ConfigError: At `follower.standoff_m` the robot would touch the person.
    """

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.config = scenario.follower
        self.sensor = sight_of(scenario)
        self.lidar = scenario.robot.lidar
        person, robot = scenario.world.person.radius_m, math.hypot(*scenario.robot.footprint)
        least = person + robot + CLEARANCE_M
        if self.config.standoff_m < least:
            raise ConfigError(
                f"follower.standoff_m = {self.config.standoff_m:g} must be at least {least:.2f}: "
                f"the radii of the person, {person:g}, and of the robot, {robot:.2f}, and "
                f"{CLEARANCE_M:g} between them"
            )

    def reset(self, seed: int) -> None:
        self._seed = seed
        scenario, config = self.scenario, self.config
        # scans wait for camera frames, which arrive later
        hold_s = self.sensor.latency_s if self.sensor.kind == "fused" else 0.0
        self.people = PersonTracker(config, self.sensor, hold_s)
        self._drive = Drive.from_scenario(scenario)
        self._view = view_of(self.sensor, config)
        self._controller: PoseController | PolarController
        if isinstance(config.control, PidControl):
            self._controller = PoseController(config.control)
        else:
            self._controller = PolarController(
                config.standoff, config.control, self._drive, self._view
            )
        self.planner: Planner | None = None
        if config.planner is not None:
            body = Extents(*scenario.robot.footprint, scenario.world.person.radius_m)
            self.planner = Planner(config, self._drive, body, self.sensor.field, seed)
        self._side = 1.0
        self._pending: deque[tuple[Twist2D, float]] = deque()
        """Commands to which the robot has not responded yet, with their durations [s]."""
        self.state: m.FollowerState | None = None
        self._newest = m.Observation()
        """The newest frame of the sensor by which the person is found."""
        self._newest_ns = -math.inf
        """Time of its arrival."""
        self._forget()

    def _forget(self) -> None:
        """Forget everything that has a place in odom."""
        self.robot = PoseHistory(round((HISTORY_S + self.sensor.latency_s) * NS_PER_S))
        self._pose: Pose2D | None = None
        """The newest pose of the robot."""
        self._sight: Estimate | None = None
        """The person when last seen."""
        self._stop_search()
        self.people.forget()
        self._controller.stop()
        if self.planner is not None:
            self.planner.forget()

    def _stop_search(self) -> None:
        self._searching: Search | None = None
        self._look: Look | None = None
        self._sent = Twist2D()

    def configure(self, scenario: Scenario) -> None:
        super().configure(scenario)
        config, self._drive = self.config, Drive.from_scenario(scenario)
        self._view = view_of(self.sensor, config)
        if isinstance(config.control, PidControl):
            assert isinstance(self._controller, PoseController)  # its kind can't change
            self._controller.configure(config.control)
        else:
            assert isinstance(self._controller, PolarController)
            self._controller.configure(config.standoff, config.control, self._drive, self._view)
        if self.planner is not None:
            self.planner.configure(config, self._drive)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the state of a tick and its command."""
        period_s = tick.period_s
        if period_s > self.config.lost_after_s:
            self.reset(self._seed)  # the last estimate is too old for a prediction
            period_s = self.scenario.sim.tick_s
        odom = inputs[ODOM]
        robot = odom.pose.pose.to_planar()
        if self._pose is not None and jumped(self._pose, robot, period_s):
            self._forget()
        self._pose = robot
        self.robot.add(tick.time_ns, robot)
        time_s = tick.time_ns / NS_PER_S
        for topic in (LEGS, OBSERVATION):
            frame = self._frame(tick.time_ns, inputs, topic)
            if frame is not None:
                self.people.add(frame)
        self._take_scan(inputs)
        person = self.people.step(time_s, self.config.standoff.person(robot))
        tracking, plan = self.people.state, None
        if person is None:
            command = self._controller.stop()
        elif tracking is TrackingState.LOST:
            command, plan = self._search(robot, period_s)
            if plan is not None and plan.state == "searching":
                tracking = TrackingState.SEARCHING
        else:
            self._stop_search()
            if tracking is TrackingState.FOLLOWING:
                self._sight = person
            command = self._follow(time_s, person, robot, period_s)
            seen = robot.between(person.pose)
            self._side = rotate(seen.x, seen.y, -self._view.centre)[1]
            plan = None if self.planner is None else self.planner.plan
        self._note_sent(command, period_s)
        reason = self._reason(tick.time_ns, robot, tracking, person)
        self._log_change(tracking, reason)
        self.state = m.FollowerState(
            header=odom.header, tracking=tracking, reason=reason, estimator=self.config.estimator
        )
        if person is not None:
            self.state = self._with_person(self.state, person, robot, plan)
        # the state precedes the command: a client that has a tick's command has all of the tick
        return {FOLLOWER_STATE: self.state, CMD_VEL: m.Twist.planar(command)}

    def _with_person(
        self, state: m.FollowerState, person: Estimate, robot: Pose2D, plan: Plan | None
    ) -> m.FollowerState:
        errors = self.config.standoff.errors(person.pose, robot)
        return replace(
            state,
            estimate=(_odometry(state.header, person),),
            goal=(m.Pose.planar(self.config.standoff.goal(person.pose)),),
            distance_error=errors.distance,
            bearing_error=errors.bearing,
            heading_error=errors.yaw,
            last_seen_s=self.people.unseen,
            plan="" if plan is None else plan.state,
            plan_reason="" if plan is None else plan.reason,
        )

    def _follow(self, time: float, person: Estimate, robot: Pose2D, dt: float) -> Twist2D:
        """Return the command for the time at which the robot responds to it.

        Until then the person walks on, and the robot executes the pending commands.
        """
        response_s, standoff = self.config.response_s, self.config.standoff
        person = person.after(response_s)
        for command, duration in self._pending:
            robot = robot.integrate(command, duration)
        if isinstance(self._controller, PolarController):  # the published law has no such rule
            person = self._heading_held(person, robot)
        goal = standoff.goal(person.pose)
        velocity = standoff.goal_velocity(person.pose, person.velocity)
        command = self._controller.command(goal, velocity, robot, dt)
        if self.planner is None:
            return command
        planned = self.planner.command(time + response_s, dt, person, robot, command)
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
        yaw = wrap(math.atan2(robot.y - y, robot.x - x) - self.config.standoff.bearing)
        velocity = person.velocity._replace(yaw=0.0)
        return person._replace(pose=Pose2D(x, y, yaw), velocity=velocity)

    def _note_sent(self, command: Twist2D, dt: float) -> None:
        """Note a command as pending for `dt` [s]."""
        response_s = self.config.response_s
        if response_s == 0.0:
            return
        self._pending.append((command, dt))
        while math.fsum(duration for _, duration in self._pending) > response_s + dt / 2:
            self._pending.popleft()

    def _search(self, robot: Pose2D, dt: float) -> tuple[Twist2D, Plan | None]:
        """Return the command for a person who is lost: drive and look, or turn, or stand."""
        twist, plan = self._controller.stop(), None
        if self.planner is not None:
            self.planner.clear_plan()
        search_s = self.config.search_s
        if self.scenario.features >= SEARCHES and search_s > 0.0 and self._sight is not None:
            if self._searching is None:
                self._searching = Search(
                    self._sight, self.sensor.field, self.scenario.robot.footprint
                )
                self._look = Look(robot[:2], self._sight.pose[:2], "where the person was last seen")
                self.people.begin_search()
            look = self._look if self.people.unseen < search_s else None
            if look is not None:
                return self._towards(look, robot, dt), Plan("searching", look.reason)
            plan = Plan("waiting", "the person was not found again")
        if self._view == ALL_AROUND:
            return twist, plan
        return twist._replace(yaw=math.copysign(TURN_RAD_S, self._side)), plan

    def _towards(self, look: Look, robot: Pose2D, dt: float) -> Twist2D:
        """Return the command on the way to a look, with the camera turned to its place."""
        law = self.config.control
        law = law if isinstance(law, PolarControl) else PolarControl()
        dx, dy = look.way[0] - robot.x, look.way[1] - robot.y
        distance = max(math.hypot(dx, dy), 1e-6)
        speed = min(SEARCH_M_S, approach(distance, SEARCH_GAIN_1_S, LINEAR_BRAKING_M_S2))
        x, y = rotate(dx / distance * speed, dy / distance * speed, -robot.yaw)
        yaw = 0.0
        to_x, to_y = look.place[0] - robot.x, look.place[1] - robot.y
        if math.hypot(to_x, to_y) > NEAR_M:
            off = wrap(math.atan2(to_y, to_x) - robot.yaw - self._view.centre)
            yaw = approach(off, law.heading_gain_1_s, HEADING_BRAKING_RAD_S2)
            yaw = min(max(yaw, -SEARCH_RAD_S), SEARCH_RAD_S)
        self._sent = self._drive.step(self._sent, Twist2D(x, y, yaw), law.max_speed_m_s, dt)
        self._controller.resume(self._sent)
        return self._sent

    def _reason(
        self, now_ns: int, robot: Pose2D, tracking: TrackingState, person: Estimate | None
    ) -> str:
        """Return why the person is not seen: the sensor's reason, or what the estimate suggests.

        The reason of a loss stays, since a robot that searches looks elsewhere.
        """
        if tracking is TrackingState.FOLLOWING:
            return ""
        if now_ns - self._newest_ns >= self.people.coast_after * NS_PER_S:
            return m.Unseen.NO_FRAMES
        if self.state is not None and self.state.tracking not in SHORTLY_UNSEEN:
            return self.state.reason
        if self._newest.reason or self._newest.poses:
            return self._newest.reason or m.Unseen.IMPLAUSIBLE
        if person is None:
            return m.Unseen.EMPTY
        seen = robot.between(person.pose)
        if math.hypot(seen.x, seen.y) > self.sensor.field.max_range:
            return m.Unseen.TOO_FAR
        bearing = wrap(math.atan2(seen.y, seen.x) - self.sensor.field.centre)
        if abs(bearing) <= self.sensor.field.half:
            return m.Unseen.EMPTY
        return m.Unseen.LEFT if bearing > 0.0 else m.Unseen.RIGHT

    def _log_change(self, tracking: str, reason: str) -> None:
        before = TrackingState.WAITING if self.state is None else self.state.tracking
        if tracking != before and not {tracking, before} <= {"following", "coasting"}:
            logger.info("msg=%s%s", tracking, f" reason={reason!r}" if reason else "")

    def _take_scan(self, inputs: Inputs) -> None:
        """Pass a scan to planner and search, with the robot's pose at its capture."""
        scan = inputs.get(SCAN)
        if scan is None:
            return
        if self.lidar is None:
            inputs.refuse(SCAN, "the robot file has no lidar, so its pose is unknown")
            return
        stamp_ns = scan.header.stamp.ns
        try:
            robot = self.robot.at(stamp_ns)
        except RefusedError as refusal:
            inputs.refuse(SCAN, str(refusal))
            return
        if self.scenario.has_real_lidar:
            scan = replace(scan, ranges=tuple(ranges_of(scan, is_real=True).tolist()))
        lidar = robot.compose(self.lidar.pose)
        if self.planner is not None:
            self.planner.see(stamp_ns / NS_PER_S, scan, lidar)
        if self._searching is not None:
            self._searching.see(scan, lidar, robot)
            self._look = self._searching.look(robot, self.people.strangers)

    def _frame(self, now_ns: int, inputs: Inputs, topic: Topic[m.Observation]) -> Frame | None:
        """Return the persons of a topic's new frame in odom; None if it is refused or empty."""
        message = inputs.get(topic)
        if message is None:
            return None
        try:
            # legs are observations too; with a camera, only camera frames can start a track
            begins = topic is not LEGS or self.sensor.kind == "legs"
            frame = self._read(now_ns, message, begins=begins) if message.poses else None
        except RefusedError as refusal:
            inputs.refuse(topic, str(refusal))
            return None
        if topic is (LEGS if self.sensor.kind == "legs" else OBSERVATION):
            self._newest, self._newest_ns = message, now_ns
        return frame

    def _read(self, now_ns: int, message: m.Observation, *, begins: bool) -> Frame:
        """Return the persons of a frame in odom.

        A pose in a frame other than `base_link` (world, odom) is assumed to be in odom.

        Raises:
            RefusedError: The robot's pose at the capture is unknown, a pose or covariance is
                invalid, or some ids are missing.
        """
        if message.ids and len(message.ids) != len(message.poses):
            raise RefusedError(f"{len(message.ids)} ids for {len(message.poses)} poses")
        # a stamp of 0 is no stamp, as in ROS
        unstamped_ns = now_ns - round(self.sensor.latency_s * NS_PER_S)
        stamp_ns = message.header.stamp.ns or max(unstamped_ns, self.robot.span_ns[0])
        moved = message.header.frame_id in ("base_link", self.scenario.controller.base_frame_id)
        robot = self.robot.at(stamp_ns) if moved else Pose2D()
        measurements = [
            check(
                Measurement(
                    robot.compose(seen.pose.to_planar()),
                    rotated(planar_covariance(seen.covariance), robot.yaw),
                    identity,
                )
            )
            for seen, identity in zip(message.poses, message.ids or repeat(""), strict=False)
        ]
        captured = stamp_ns / NS_PER_S
        if not self.robot.span_ns[0] <= stamp_ns <= now_ns:  # of another clock
            captured = now_ns / NS_PER_S - self.sensor.latency_s
        return Frame(captured, measurements, begins)

    def diagnostics(self) -> dict[str, object]:
        """Return the tracking state, the distance error and the filter's consistency (NIS)."""
        values: dict[str, object] = {"nis": self.people.estimator.nis}
        if self.state is not None:
            values["tracking"] = self.state.tracking
            if self.state.reason:
                values["reason"] = self.state.reason
            if self.state.estimate:
                values["distance_error_m"] = round(self.state.distance_error, 3)
            if self.state.plan:
                values["plan"] = self.state.plan
        return values


def _odometry(header: m.Header, person: Estimate) -> m.Odometry:
    """Return an estimate as a message, with the velocity in the person's frame."""
    vx, vy = rotate(person.velocity.x, person.velocity.y, -person.pose.yaw)
    pose = m.PoseWithCovariance(
        pose=m.Pose.planar(person.pose), covariance=ros_covariance(person.covariance)
    )
    twist = m.TwistWithCovariance(twist=m.Twist.planar(Twist2D(vx, vy, person.velocity.yaw)))
    return m.Odometry(header=header, child_frame_id="person", pose=pose, twist=twist)
