"""The follower: odometry and observations to cmd_vel."""

from __future__ import annotations

from mecazen import keys
from mecazen.bus import Bus
from mecazen.config import Scenario
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
from mecazen.service import NS_PER_S, Service
from mecazen.wire import Stamp

from mecazen_follower.config import FollowerConfig
from mecazen_follower.estimators import Estimate
from mecazen_follower.following import Following, Sighting, Step
from mecazen_follower.observation import in_odom, ros_covariance

HISTORY_TICKS = 500
"""Odometry that is kept for observations that come late."""


class FollowerService(Service):
    """Estimates the person from noisy observations and drives the robot to its place.

    At every tick `odom` gives the robot's pose; in ticks that bring a frame of the sensor,
    the follower waits for `target/observation` as well. Then it publishes `cmd_vel` and
    `follower/state`. A frame that is late is taken in at the next tick, with the robot's
    pose at its capture.
    """

    NAME = "follower"

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        self.config = scenario.section(FollowerConfig, "follower")
        self.dt = scenario.sim.tick_s
        self.ticks_per_frame = scenario.sensor.ticks_per_frame(self.dt)
        self.sees = "target" in scenario.services
        self.cmd_vel = bus.publisher(keys.CMD_VEL)
        self.state = bus.publisher(keys.FOLLOWER_STATE)
        super().__init__(bus, scenario)
        self.answer_every_tick(keys.ODOM, self.on_odom)
        self.subscribe(keys.OBSERVATION, self.on_observation)

    def reset(self, seed: int) -> None:
        """Forget the person and the way."""
        del seed
        self.following = Following(self.config, self.scenario.sensor.latency_s)
        self.robot: dict[int, Pose2D] = {}
        self.frame: Observation | None = None
        self.frame_ns = -1
        self.odom: Odometry | None = None
        self.odom_stamp = self.last_stamp = Stamp(0, 0, 0)
        self.late_frames = 0

    def on_odom(self, odom: Odometry, stamp: Stamp) -> None:
        """Take the robot's pose of a tick; act, unless a frame of this tick is still to come."""
        if self.odom is not None:
            self.late_frames += 1
            self._act(self.odom)
        self.odom, self.odom_stamp = odom, stamp
        self.robot[stamp.time_ns] = odom.pose.pose.to_planar()
        if len(self.robot) > HISTORY_TICKS:
            del self.robot[next(iter(self.robot))]
        due = self.sees and self.tick_of(stamp) % self.ticks_per_frame == 0
        if not due or self.frame_ns == stamp.time_ns:
            self._act(odom)

    def on_observation(self, frame: Observation, stamp: Stamp | None) -> None:
        """Take a frame; act, if it is the one that the tick waits for."""
        self.frame = frame
        self.frame_ns = -1 if stamp is None else stamp.time_ns
        if self.odom is not None and self.frame_ns == self.odom_stamp.time_ns:
            self._act(self.odom)

    def _act(self, odom: Odometry) -> None:
        """Publish the command of a tick."""
        self.odom = None
        stamp, robot = self.odom_stamp, odom.pose.pose.to_planar()
        elapsed_ns = stamp.time_ns - self.last_stamp.time_ns
        self.last_stamp = stamp
        if elapsed_ns > 0:
            self.following.predict(elapsed_ns / NS_PER_S)
        time = stamp.time_ns / NS_PER_S
        try:
            step = self.following.step(time, self.dt, robot, self._sighting(robot))
        except ValueError as refusal:
            self.bus.refuse(keys.OBSERVATION.key, str(refusal))
            step = self.following.step(time, self.dt, robot, None)
        self.cmd_vel.put(Twist.planar(step.command), stamp)
        self.state.put(_state(odom.header, self.config.estimator, step), stamp)

    def _sighting(self, robot: Pose2D) -> Sighting | None:
        """Take the waiting frame; return the person in it in odom, if it shows one."""
        frame, self.frame = self.frame, None
        if frame is None or not frame.poses:
            return None
        # a frame from before the history, or of a foreign clock, is placed as if taken now
        robot = self.robot.get(frame.header.stamp.ns, robot)
        return in_odom(frame.poses[0], frame.header.frame_id, robot)

    def diagnostics(self) -> dict[str, object]:
        """Return frames that came too late for their tick, and the filter's consistency."""
        return {"late_frames": self.late_frames, "nis": self.following.estimator.nis}


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
