"""The follower: odometry and observations to cmd_vel."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from functools import partial
from itertools import repeat

from mecazen import messages as m
from mecazen.config import FollowerConfig, Scenario, SensorConfig
from mecazen.drive import Drive
from mecazen.errors import ConfigError, RefusedError
from mecazen.geometry import Pose2D, PoseHistory, Twist2D, jumped, rotate, wrap
from mecazen.graph import SEARCHES
from mecazen.keys import CMD_VEL, FOLLOWER_STATE, LEGS, OBSERVATION, ODOM, SCAN, Topic
from mecazen.messages import PlanarCovariance, planar_covariance, ros_covariance
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.ticks import ticks_per_sample
from mecazen.wire import NS_PER_S
from msgspec.structs import replace

from mecazen_follower.association import Measurement, check
from mecazen_follower.control import FieldOfView, kept_view
from mecazen_follower.estimators import Estimate
from mecazen_follower.following import Following, Step
from mecazen_follower.planner.costs import Extents
from mecazen_follower.planner.mppi import Planner
from mecazen_follower.search import Search
from mecazen_follower.tracker import Frame, TrackingState

logger = logging.getLogger(__name__)

HISTORY_S = 5.0
"""Time beyond the sensor's latency for which odometry is kept for late observations [s]."""

CLEARANCE_M = 0.1
"""Minimum gap between person and robot, for the error of following [m]."""
SHORTLY_UNSEEN = (TrackingState.WAITING, TrackingState.FOLLOWING, TrackingState.COASTING)
"""The states before the person is lost."""

BESIDE = math.sin(math.radians(60.0))
"""Sine of the bearing beyond which the robot is beside the person. If the robot turns away from its
heading there, its wheels are too slow to return. So the robot does not turn to keep the person in
the camera's view and relies on the lidar, unless the planner gives up the heading first."""


class FollowerNode(Node):
    """Estimates the person from noisy observations and drives the robot to its goal.

    An observation is transformed with the robot's pose at its capture, even if it arrives late.

    Raises:
        ConfigError: At `follower.standoff_m` the robot would touch the person.
    """

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.config = scenario.follower
        self.sensor = data_sheet(scenario)
        person, robot = scenario.world.person.radius_m, math.hypot(*scenario.robot.footprint)
        least = person + robot + CLEARANCE_M
        if self.config.standoff_m < least:
            raise ConfigError(
                f"follower.standoff_m = {self.config.standoff_m:g} must be at least {least:.2f}: "
                f"the radii of the person, {person:g}, and of the robot, {robot:.2f}, and "
                f"{CLEARANCE_M:g} between them"
            )
        if self.config.planner is not None:
            key, rate_hz = "follower.planner.rate_hz", self.config.planner.rate_hz
            ticks_per_sample(key, rate_hz, scenario.sim.tick_s)
        self.lidar = scenario.robot.lidar

    def reset(self, seed: int) -> None:
        """Discard the person and the robot's past poses."""
        self._seed = seed
        sensor, drive = self.sensor, Drive.from_scenario(self.scenario)
        view = view_of(self.scenario, sensor, self.config)
        # scans wait for camera frames, which arrive later
        hold_s = sensor.latency_s if sensor.kind == "fused" else 0.0
        planner = make_planner(self.scenario, sensor, seed)
        begin_search = make_search(self.scenario, sensor)
        self.following = Following(self.config, sensor, drive, view, hold_s, planner, begin_search)
        self._forget_poses()
        self.state: m.FollowerState | None = None
        self._newest = m.Observation()
        """The newest frame of the sensor by which the person is found."""
        self._newest_ns = -math.inf
        """Time of its arrival."""

    def _forget_poses(self) -> None:
        self.robot = PoseHistory(round((HISTORY_S + self.sensor.latency_s) * NS_PER_S))
        self._pose: Pose2D | None = None
        """The newest pose of the robot."""

    def configure(self, scenario: Scenario) -> None:
        """Use the changed configuration from now on."""
        super().configure(scenario)
        view = view_of(scenario, self.sensor, self.config)
        self.following.configure(self.config, Drive.from_scenario(scenario), view)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the state of a tick and its command."""
        period_s = tick.period_s
        if period_s > self.config.lost_after_s:
            self.reset(self._seed)  # the last estimate is too old for a prediction
            period_s = self.scenario.sim.tick_s
        odom = inputs[ODOM]
        robot = odom.pose.pose.to_planar()
        if self._pose is not None and jumped(self._pose, robot, period_s):
            self._forget_poses()
            self.following.forget()
        self._pose = robot
        self.robot.add(tick.time_ns, robot)
        time_s = tick.time_ns / NS_PER_S
        # legs are observations too; with a camera, only camera frames can start a track
        legs = self._frame(tick.time_ns, inputs, LEGS)
        if legs is not None:
            self.following.people.add(legs._replace(begins=self.sensor.kind == "legs"))
        self._take_scan(inputs)
        frame = self._frame(tick.time_ns, inputs, OBSERVATION)
        step = self.following.step(time_s, period_s, robot, frame)
        reason = self._reason(tick.time_ns, robot, step)
        self._log_change(step.tracking, reason)
        self.state = _state(odom.header, self.config.estimator, step, reason)
        # the state precedes the command: a client that has a tick's command has all of the tick
        return {FOLLOWER_STATE: self.state, CMD_VEL: m.Twist.planar(step.command)}

    def _reason(self, now_ns: int, robot: Pose2D, step: Step) -> str:
        """Return why the person is not seen: the sensor's reason, or what the estimate suggests.

        The reason of a loss stays, since a robot that searches looks elsewhere.
        """
        if step.tracking is TrackingState.FOLLOWING:
            return ""
        if now_ns - self._newest_ns >= self.following.people.coast_after * NS_PER_S:
            return m.Unseen.NO_FRAMES
        if self.state is not None and self.state.tracking not in SHORTLY_UNSEEN:
            return self.state.reason
        if self._newest.reason or self._newest.poses:
            return self._newest.reason or m.Unseen.IMPLAUSIBLE
        if step.person is None:
            return m.Unseen.EMPTY
        field = _field_of(self.scenario, self.sensor)
        seen = robot.between(step.person.pose)
        if math.hypot(seen.x, seen.y) > field.max_range:
            return m.Unseen.TOO_FAR
        bearing = wrap(math.atan2(seen.y, seen.x) - field.centre)
        if abs(bearing) <= field.half:
            return m.Unseen.EMPTY
        return m.Unseen.LEFT if bearing > 0.0 else m.Unseen.RIGHT

    def _log_change(self, tracking: str, reason: str) -> None:
        """Log that the person is found or lost."""
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
        self.following.see(stamp_ns / NS_PER_S, scan, robot, robot.compose(self.lidar.pose))

    def _frame(self, now_ns: int, inputs: Inputs, topic: Topic[m.Observation]) -> Frame | None:
        """Return the persons of a topic's new frame in odom; None if it is refused or empty."""
        message = inputs.get(topic)
        if message is None:
            return None
        try:
            frame = self._read(now_ns, message) if message.poses else None
        except RefusedError as refusal:
            inputs.refuse(topic, str(refusal))
            return None
        if topic is (LEGS if self.sensor.kind == "legs" else OBSERVATION):
            self._newest, self._newest_ns = message, now_ns
        return frame

    def _read(self, now_ns: int, message: m.Observation) -> Frame:
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
                    _rotated(planar_covariance(seen.covariance), robot.yaw),
                    identity,
                )
            )
            for seen, identity in zip(message.poses, message.ids or repeat(""), strict=False)
        ]
        return Frame(self._captured(now_ns, stamp_ns), measurements)

    def _captured(self, now_ns: int, stamp_ns: int) -> float:
        """Return the time of a frame's capture [s]: its stamp, if it is plausible.

        A stamp of another clock is not usable: the capture is then estimated by the latency of the
        data sheet.
        """
        if self.robot.span_ns[0] <= stamp_ns <= now_ns:
            return stamp_ns / NS_PER_S
        return now_ns / NS_PER_S - self.sensor.latency_s

    def diagnostics(self) -> dict[str, object]:
        """Return the tracking state, the distance error and the filter's consistency (NIS)."""
        values: dict[str, object] = {"nis": self.following.people.estimator.nis}
        if self.state is not None:
            values["tracking"] = self.state.tracking
            if self.state.reason:
                values["reason"] = self.state.reason
            if self.state.estimate:
                values["distance_error_m"] = round(self.state.distance_error, 3)
            if self.state.plan:
                values["plan"] = self.state.plan
        return values


def data_sheet(scenario: Scenario) -> SensorConfig:
    """Return rate, latency, field of view and range of the sensor by which the person is found."""
    sensor, lidar, camera = scenario.sensor, scenario.sensors.lidar, scenario.sensors.tracker
    if sensor.kind == "pose":
        return sensor
    if sensor.kind == "legs":
        return replace(
            sensor,
            rate_hz=lidar.rate_hz,
            latency_s=0.0,
            fov_deg=lidar.fov_deg,
            max_range_m=lidar.max_range_m,
        )
    return replace(
        sensor,
        rate_hz=camera.rate_hz,
        latency_s=camera.latency_s,
        fov_deg=camera.horizontal_fov_deg,
        max_range_m=camera.max_range_m,
    )


def make_planner(scenario: Scenario, sensor: SensorConfig, seed: int) -> Planner | None:
    """Return a new planner for a scenario's robot and its sensor, if one is configured."""
    if scenario.follower.planner is None:
        return None
    return Planner(
        scenario.follower,
        Drive.from_scenario(scenario),
        Extents(*scenario.robot.footprint, scenario.world.person.radius_m),
        _field_of(scenario, sensor),
        seed,
        has_real_lidar=scenario.has_real_lidar,
    )


def make_search(scenario: Scenario, sensor: SensorConfig) -> Callable[[Estimate], Search] | None:
    """Return what begins a search for a lost person, if the robot has a lidar and a camera."""
    if not scenario.features >= SEARCHES or scenario.follower.search_s == 0.0:
        return None
    return partial(
        Search,
        view=_field_of(scenario, sensor),
        footprint=scenario.robot.footprint,
        is_real=scenario.has_real_lidar,
    )


def view_of(scenario: Scenario, sensor: SensorConfig, config: FollowerConfig) -> FieldOfView:
    """Return the field of view in which the robot keeps the person, by turning."""
    field = _field_of(scenario, sensor)
    view = kept_view(2.0 * field.half, field.centre)
    beside = abs(math.sin(config.standoff.bearing)) > BESIDE
    turns = config.planner is not None and config.planner.turns_to_see
    if sensor.kind == "fused" and beside and not turns:
        return view._replace(half=math.pi)
    return view


def _field_of(scenario: Scenario, sensor: SensorConfig) -> FieldOfView:
    """Return the field of view of the sensor by which the person is found."""
    camera = scenario.robot.camera if sensor.kind in ("body", "fused") else None
    yaw_deg = 0.0 if camera is None else camera.yaw_deg
    half = math.radians(sensor.fov_deg) / 2.0
    return FieldOfView(half, math.radians(yaw_deg), sensor.max_range_m)


def _state(header: m.Header, estimator: str, step: Step, reason: str) -> m.FollowerState:
    tracking, errors = step.tracking, step.errors
    state = m.FollowerState(header=header, tracking=tracking, reason=reason, estimator=estimator)
    if step.person is None:
        return state
    return replace(
        state,
        estimate=(_odometry(header, step.person),),
        goal=(m.Pose.planar(step.goal),),
        distance_error=errors.distance,
        bearing_error=errors.bearing,
        heading_error=errors.yaw,
        last_seen_s=step.unseen,
        plan="" if step.plan is None else step.plan.state,
        plan_reason="" if step.plan is None else step.plan.reason,
    )


def _odometry(header: m.Header, person: Estimate) -> m.Odometry:
    """Return an estimate as a message, with the velocity in the person's frame."""
    vx, vy = rotate(person.velocity.x, person.velocity.y, -person.pose.yaw)
    pose = m.PoseWithCovariance(
        pose=m.Pose.planar(person.pose), covariance=ros_covariance(person.covariance)
    )
    twist = m.TwistWithCovariance(twist=m.Twist.planar(Twist2D(vx, vy, person.velocity.yaw)))
    return m.Odometry(header=header, child_frame_id="person", pose=pose, twist=twist)


def _rotated(covariance: PlanarCovariance, yaw: float) -> PlanarCovariance:
    """Return a 3x3 covariance C of (x, y, yaw) as R C Rᵀ, R the rotation by `yaw` [rad]."""
    (xx, xy, xw), (yx, yy, yw), (wx, wy, ww) = covariance
    c, s = math.cos(yaw), math.sin(yaw)
    # first R C over x and y, then the product
    cxx, cxy, cyx, cyy = c * xx - s * yx, c * xy - s * yy, s * xx + c * yx, s * xy + c * yy
    return (
        (c * cxx - s * cxy, s * cxx + c * cxy, c * xw - s * yw),
        (c * cyx - s * cyy, s * cyx + c * cyy, s * xw + c * yw),
        (c * wx - s * wy, s * wx + c * wy, ww),
    )
