"""The follower: odometry and observations to cmd_vel."""

from __future__ import annotations

from collections import deque

from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import Scenario
from mecazen.covariance import ros_covariance
from mecazen.follower import Follower
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.messages import (
    FollowerState,
    Header,
    Observation,
    Odometry,
    Pose,
    PoseWithCovariance,
    Twist,
    TwistWithCovariance,
)
from mecazen.service import NS_PER_S
from mecazen.wire import Stamp

from mecazen_follower.config import FollowerConfig
from mecazen_follower.estimators import Estimate
from mecazen_follower.following import Following, Measurement, Step
from mecazen_follower.observation import in_odom

HISTORY_TICKS = 500
"""Odometry that is kept, besides the sensor's latency, for observations that come late."""


class FollowerService(Follower):
    """Estimates the person from noisy observations and drives the robot to its place.

    At every tick it publishes `follower/state` and `cmd_vel`. An observation is placed with
    the robot's pose at its capture, however late it comes.
    """

    PRIORITY = 2

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        self.config = scenario.section(FollowerConfig, "follower")
        self.history_ticks = HISTORY_TICKS + round(scenario.sensor.latency_s / scenario.sim.tick_s)
        self.lost_after_ns = round(self.config.lost_after_s * NS_PER_S)
        self.state = bus.publisher(keys.FOLLOWER_STATE)
        super().__init__(bus, scenario)

    def reset(self, seed: int) -> None:
        """Forget the person and the way."""
        del seed
        self.following = Following(self.config, self.scenario.sensor.latency_s)
        self.robot: deque[tuple[int, Pose2D]] = deque(maxlen=self.history_ticks)
        """Where the robot was, by simulated time [ns], the newest last."""
        self.last_ns: int | None = None
        self.told: FollowerState | None = None

    def follow(self, odom: Odometry, frame: Observation | None, stamp: Stamp) -> Twist2D:
        """Publish the state of a tick, and return its command."""
        if self.last_ns is not None and stamp.time_ns - self.last_ns > self.lost_after_ns:
            self.reset(stamp.seed)  # what was known so long ago is worth no prediction
        robot = odom.pose.pose.to_planar()
        self.robot.append((stamp.time_ns, robot))
        dt = self.dt
        if self.last_ns is not None:
            dt = (stamp.time_ns - self.last_ns) / NS_PER_S
            self.following.predict(dt)
        self.last_ns = stamp.time_ns
        time = stamp.time_ns / NS_PER_S
        try:
            step = self.following.step(time, dt, robot, self._measurement(frame, robot))
        except ValueError as refusal:
            self.bus.refuse(keys.OBSERVATION.key, str(refusal))
            step = self.following.step(time, dt, robot, None)
        # before the command: who has the command of a tick has all of the tick
        self.told = _state(odom.header, self.config.estimator, step)
        self.state.put(self.told, stamp)
        return step.command

    def _measurement(self, frame: Observation | None, robot: Pose2D) -> Measurement | None:
        """Return the person in a frame in odom, if it shows one."""
        if frame is None or not frame.poses:
            return None
        # a frame from before the history, or of a foreign clock, is placed as if taken now
        captured_ns = frame.header.stamp.ns
        robot = next((was for at_ns, was in reversed(self.robot) if at_ns == captured_ns), robot)
        return in_odom(frame.poses[0], frame.header.frame_id, robot)

    def diagnostics(self) -> dict[str, object]:
        """Return how well it follows, frames too late for their tick, the filter's consistency."""
        values: dict[str, object] = {
            "late_frames": self.late_frames,
            "nis": self.following.estimator.nis,
        }
        if self.told is not None:
            values["tracking"] = self.told.tracking
            values["distance_error_m"] = round(self.told.distance_error, 3)
        return values


def _state(header: Header, estimator: str, step: Step) -> FollowerState:
    tracking, errors = step.tracking, step.errors
    if step.person is None:
        return FollowerState(header=header, tracking=tracking, estimator=estimator)
    return FollowerState(
        header=header,
        tracking=tracking,
        estimator=estimator,
        estimate=(_odometry(header, step.person),),
        goal=(Pose.planar(step.goal),),
        distance_error=errors.distance,
        bearing_error=errors.bearing,
        heading_error=errors.yaw,
        last_seen_s=step.unseen,
    )


def _odometry(header: Header, person: Estimate) -> Odometry:
    """Return an estimate as a message: the velocity turned into the person's own frame."""
    vx, vy = rotate(person.velocity.x, person.velocity.y, -person.pose.yaw)
    pose = PoseWithCovariance(
        pose=Pose.planar(person.pose), covariance=ros_covariance(person.covariance)
    )
    twist = TwistWithCovariance(twist=Twist.planar(Twist2D(vx, vy, person.velocity.yaw)))
    return Odometry(header=header, child_frame_id="person", pose=pose, twist=twist)
