"""The controller: cmd_vel to wheel commands, and joint states to odometry."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from mecazen import keys
from mecazen.bus import Bus, Reply
from mecazen.config import Scenario
from mecazen.covariance import diagonal_covariance
from mecazen.errors import ConfigError
from mecazen.geometry import Twist2D
from mecazen.messages import (
    Header,
    JointState,
    Odometry,
    OdometryRequest,
    Twist,
    planar_odometry,
)
from mecazen.service import Service
from mecazen.wire import Stamp

from mecazen_controller.config import ControllerConfig
from mecazen_controller.kinematics import WheelSpeeds
from mecazen_controller.limiter import LimiterState, limit_twist
from mecazen_controller.odometry import Odometry as DeadReckoning

AT_REST = (LimiterState(), LimiterState(), LimiterState())

MAX_VALUE = 1e6
"""No speed [m/s, rad/s] or coordinate [m] of a robot is larger; one that is gets refused."""


class ControllerService(Service):
    """Wheel kinematics, odometry, limits and the command watchdog.

    At every tick the measured wheels give `odom`, and the newest reference, limited, gives
    `joint_command`. Where a follower takes part, the command waits for its `cmd_vel` of the
    tick; a reference that comes later still changes the command of the same tick, so it
    never waits for the next one.
    """

    NAME = "controller"
    PRIORITY = 3

    def __init__(self, bus: Bus, scenario: Scenario) -> None:
        config = scenario.section(ControllerConfig, "controller")
        self.config = config
        self.dt = scenario.sim.tick_s
        try:
            self.ticks_per_update = config.ticks_per_update(self.dt)
        except ValueError as error:
            raise ConfigError(f"controller.{error}") from None
        self.kinematics = config.kinematics(scenario.robot)
        self.max_speed = scenario.robot.wheels.max_speed_rad_s
        self.limits = config.limits.limits
        self.timeout_ticks = math.floor(config.reference_timeout_s / self.dt + 1e-9)
        self.pose_covariance = diagonal_covariance(config.pose_covariance_diagonal)
        self.twist_covariance = diagonal_covariance(config.twist_covariance_diagonal)
        self.led = "follower" in scenario.services
        self.only_led = self.led and scenario.sim.mode == "lockstep"
        self.joints_known = False
        """Whether joint_states has ever named the wheels: then the names are right."""
        self.odom = bus.publisher(replace(keys.ODOM, key=config.odometry_key))
        self.joint_command = bus.publisher(keys.JOINT_COMMAND)
        super().__init__(bus, scenario)
        if config.odometry == "wheel":
            self.answer_every_tick(keys.JOINT_STATES, self.on_joint_states)
        else:
            self.answer_every_tick(keys.GROUND_TRUTH, self.on_ground_truth)
        self.command_topic = replace(keys.CMD_VEL, key=config.command_key)
        self.subscribe(self.command_topic, self.on_cmd_vel, advances_clock=False)
        bus.serve(keys.SET_ODOMETRY, self.on_set_odometry)

    def reset(self, seed: int) -> None:
        """Stand at the start, without a reference."""
        del seed
        self.dead_reckoning = DeadReckoning(self.config.odometry_scale.factors)
        self.dead_reckoning.set(self.scenario.start.pose)
        self.tick = -1
        self.tick_stamp = self.stamp
        self.reference = Twist2D()
        self.reference_tick: int | None = None
        self.velocity = self.next_velocity = AT_REST
        self.awaiting_reference = False

    def on_joint_states(self, joints: JointState, stamp: Stamp) -> None:
        """Publish the odometry of a tick from the wheels' measured speeds."""
        try:
            measured = WheelSpeeds(*[_velocity(joints, name) for name in self.config.wheel_joints])
        except KeyError as missing:
            problem = f"controller.wheel_joints: joint_states has no velocity of {missing}"
            if self.joints_known:
                self.bus.refuse(keys.JOINT_STATES.key, problem)
                return
            raise ConfigError(problem) from None
        self.joints_known = True
        if not _plausible(measured):
            self.bus.refuse(keys.JOINT_STATES.key, f"speeds out of range: {tuple(measured)}")
            return
        moving = self.kinematics.forward(measured)
        elapsed = self._begin_tick(stamp, moving)
        self.dead_reckoning.update(moving, elapsed * self.dt)
        self._answer(
            planar_odometry(
                stamp.time,
                self.config.odom_frame_id,
                self.config.base_frame_id,
                self.dead_reckoning.pose,
                self.dead_reckoning.twist,
                self.pose_covariance,
                self.twist_covariance,
            )
        )

    def on_ground_truth(self, truth: Odometry, stamp: Stamp) -> None:
        """Publish the truth as the odometry of a tick."""
        self._begin_tick(stamp, truth.twist.twist.to_planar())
        self._answer(
            Odometry(
                header=Header(stamp=stamp.time, frame_id=self.config.odom_frame_id),
                child_frame_id=self.config.base_frame_id,
                pose=truth.pose,
                twist=truth.twist,
            )
        )

    def on_cmd_vel(self, twist: Twist, stamp: Stamp | None) -> None:
        """Take a reference, and command the wheels with it at once."""
        if self.tick < 0 or (self.only_led and stamp is None):
            return
        reference = twist.to_planar()
        if _plausible(reference):
            self.reference, self.reference_tick = reference, self.tick
        else:
            self.bus.refuse(self.command_topic.key, f"speed out of range: {tuple(reference)}")
        self._command()

    def on_set_odometry(self, request: OdometryRequest, reply: Reply[Odometry]) -> None:
        """Let the odometry go on from the given pose."""
        if self.config.odometry != "wheel":
            reply.refuse("controller.odometry is ground_truth: there is nothing to set")
            return
        pose = request.pose.to_planar()
        if not _plausible(pose):
            reply.refuse(f"pose out of range: coordinates must be within {MAX_VALUE:g} m")
            return
        self.dead_reckoning.set(pose)
        reply.answer(
            planar_odometry(
                self.stamp.time,
                self.config.odom_frame_id,
                self.config.base_frame_id,
                self.dead_reckoning.pose,
                self.dead_reckoning.twist,
            )
        )

    def _begin_tick(self, stamp: Stamp, moving: Twist2D) -> int:
        """Close the last tick, and return how many ticks have passed since."""
        if self.awaiting_reference:
            # the follower is late or gone: the tick ends with the reference there is
            self._command()
        last, self.tick = self.tick, self.tick_of(stamp)
        self.tick_stamp = stamp
        self.velocity = self.next_velocity
        if last < 0 < self.tick or self.tick - last > self.timeout_ticks:
            # what was commanded is no more, or never was: go on from how the robot moves
            x, y, yaw = (LimiterState(velocity) for velocity in moving)
            self.velocity = x, y, yaw
        return 0 if last < 0 else self.tick - last

    def _answer(self, odometry: Odometry) -> None:
        due = self.tick % self.ticks_per_update == 0
        self.awaiting_reference = self.led and due
        if due:
            self.odom.put(odometry, self.tick_stamp)
        if not self.awaiting_reference:
            self._command()

    def _command(self) -> None:
        """Publish the wheel command of this tick; again, when the reference has changed."""
        self.awaiting_reference = False
        self.next_velocity = limit_twist(self.velocity, self._wanted(), self.limits, self.dt)
        x, y, yaw = self.next_velocity
        wanted = Twist2D(x.velocity, y.velocity, yaw.velocity)
        speeds = self.kinematics.inverse(wanted).desaturate(self.max_speed)
        self.joint_command.put(
            JointState(
                header=Header(stamp=self.tick_stamp.time),
                name=self.config.wheel_joints,
                velocity=tuple(speeds),
            ),
            self.tick_stamp,
        )

    def _wanted(self) -> Twist2D:
        """Return the reference, or rest where there is none or it is stale."""
        if self.reference_tick is None or self.tick - self.reference_tick > self.timeout_ticks:
            return Twist2D()
        return self.reference

    def diagnostics(self) -> dict[str, object]:
        """Return the age of the reference."""
        if self.reference_tick is None:
            return {"reference": "none yet"}
        return {"reference_age_s": round((self.tick - self.reference_tick) * self.dt, 6)}


def _velocity(joints: JointState, name: str) -> float:
    """Return the velocity of a joint; wheels come first, so a search is shorter than a table."""
    try:
        return joints.velocity[joints.name.index(name)]
    except (ValueError, IndexError):
        raise KeyError(name) from None


def _plausible(values: Iterable[float]) -> bool:
    return all(abs(value) <= MAX_VALUE for value in values)
