"""The controller's nodes: joint states to odometry, and cmd_vel to wheel commands."""

from __future__ import annotations

import logging
import math
from typing import Any

import numpy as np
from mecazen import messages as m
from mecazen.commands import Commands, Source, sources
from mecazen.config import Scenario
from mecazen.config.services import OdometryNoise
from mecazen.drive import Drive, LimiterState, axis_limits
from mecazen.errors import ConfigError
from mecazen.geometry import Twist2D
from mecazen.keys import (
    GROUND_TRUTH,
    GUARD_CMD_VEL,
    JOINT_COMMAND,
    JOINT_STATES,
    ODOM,
    Call,
)
from mecazen.messages import diagonal_covariance
from mecazen.node import Inputs, Node, Outputs, Tick
from mecazen.ticks import ROUNDING_S
from mecazen.wheels import PLAUSIBLE_SPEED, MecanumKinematics, WheelSpeeds, wheel_values
from mecazen.wire import NS_PER_S, RefusedError
from numpy.random import PCG64, Generator

logger = logging.getLogger(__name__)

MISMATCH = 0.2
"""Relative difference of a configured length from the robot's above which the controller warns.
A calibration is within 10 %; a diameter or another unit in its place is at least a factor of 2."""

NOISE_STREAM = 11
"""Number of the random stream of the odometry's noise."""


class OdometryNode(Node):
    """Odometry from the wheels' angles and speeds, or the ground truth of the simulator."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.config, self.joints = scenario.controller, scenario.robot.wheels.joints
        self.kinematics = MecanumKinematics.from_robot(scenario.robot, self.config)
        self.ticks_per_sample = scenario.ticks_per("controller.update_rate_hz")
        self.pose_covariance = diagonal_covariance(self.config.pose_covariance_diagonal)
        self.twist_covariance = diagonal_covariance(self.config.twist_covariance_diagonal)
        self.wheels_known = False
        """Whether a sample of joint_states contained all wheel joints, so that the configured names
        are right."""

    def reset(self, seed: int) -> None:
        """Set the odometry to the start pose, at rest."""
        self.random = Generator(PCG64([seed, NOISE_STREAM]))
        self.pose, self.twist = self.scenario.start.pose, Twist2D()
        self.time = m.Time()
        self.measured_ns: int | None = None
        """Time of the newest wheel measurement [ns]; the pose belongs to this time."""
        self.angles: tuple[float, ...] = ()
        """Wheel angles at `measured_ns` [rad]; empty if the measurement had none."""

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the odometry, in ticks in which a sample is due."""
        self.time = tick.time
        if self.config.odometry == "ground_truth":
            odometry = self._truth(inputs[GROUND_TRUTH])
        else:
            joints = inputs[JOINT_STATES]
            try:
                measured = wheel_speeds(joints, self.joints)
            except RefusedError as problem:
                if not self.wheels_known:
                    raise ConfigError(f"robot.wheels.joints: {problem}") from None
                inputs.refuse(JOINT_STATES, str(problem))
                return {}
            self.wheels_known = True
            self._move(measured, wheel_values(joints, joints.position, self.joints))
            self.measured_ns = tick.time_ns
            odometry = self._odometry(self.pose_covariance, self.twist_covariance)
        return {} if tick.number % self.ticks_per_sample else {ODOM: odometry}

    def answer(self, call: Call[Any, Any], request: m.Message) -> m.Odometry:
        """Continue the odometry from the pose of a request."""
        assert isinstance(request, m.OdometryRequest)
        if self.config.odometry != "wheel":
            raise RefusedError("controller.odometry is ground_truth: there is nothing to set")
        self.pose = request.pose.to_planar()
        return self._odometry()

    def _move(self, speeds: WheelSpeeds, angles: tuple[float, ...]) -> None:
        """Move the pose by the angles through which the wheels turned since the last measurement.

        The present speeds replace angles that are missing, and angles that no motion explains,
        because a counter wrapped or started again.
        """
        self.twist = mean = self._scaled(speeds)
        last_ns = self.time.ns if self.measured_ns is None else self.measured_ns
        moved_s = (self.time.ns - last_ns) / NS_PER_S
        if self.angles and angles and moved_s > 0.0:
            pairs = zip(angles, self.angles, strict=True)
            turning = WheelSpeeds(*((now - last) / moved_s for now, last in pairs))
            max_speed = self.scenario.robot.wheels.max_speed_rad_s
            if max(map(abs, turning)) <= PLAUSIBLE_SPEED * max_speed:
                mean = self._scaled(turning)
        std = self.config.odometry_noise
        if std != OdometryNoise():
            noise = self.random.standard_normal(3) * (std.x_m_s, std.y_m_s, std.yaw_rad_s)
            self.twist, mean = (
                Twist2D(*(np.asarray(twist) + noise).tolist()) for twist in (self.twist, mean)
            )
        self.pose = self.pose.integrate(mean, moved_s)
        self.angles = angles

    def _scaled(self, speeds: WheelSpeeds) -> Twist2D:
        """Return the twist of the wheel speeds; the calibration scales each axis."""
        twist, scale = self.kinematics.forward(speeds), self.config.odometry_scale
        return Twist2D(twist.x * scale.x, twist.y * scale.y, twist.yaw * scale.yaw)

    def _odometry(self, *covariances: tuple[float, ...]) -> m.Odometry:
        frames = self.config.odom_frame_id, self.config.base_frame_id
        return m.planar_odometry(self.time, *frames, self.pose, self.twist, *covariances)

    def _truth(self, truth: m.Odometry) -> m.Odometry:
        return m.Odometry(
            header=m.Header(stamp=self.time, frame_id=self.config.odom_frame_id),
            child_frame_id=self.config.base_frame_id,
            pose=truth.pose,
            twist=truth.twist,
        )


class ControllerNode(Node):
    """Wheel speeds for the commanded twist that is obeyed, within limits; zero if there is none.

    The limits apply once per tick, independent of the number of commands in it.
    """

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.config, self.joints = scenario.controller, scenario.robot.wheels.joints
        self.kinematics = MecanumKinematics.from_robot(scenario.robot, self.config)
        self.max_speed = scenario.robot.wheels.max_speed_rad_s
        self.tick_s = scenario.sim.tick_s
        self.commands = Commands(())
        self._read_limits()
        robot = MecanumKinematics.from_robot(scenario.robot)
        for name in ("half_wheelbase", "half_track", "wheel_radius"):
            configured, actual = getattr(self.kinematics, name), getattr(robot, name)
            if abs(configured - actual) > MISMATCH * actual:
                mismatch = f"controller.{name}_m = {configured:g}, the robot file has {actual:g} m"
                logger.warning("msg=%r", mismatch)

    def configure(self, scenario: Scenario) -> None:
        """Use the limits and the timeout of a changed scenario from now on."""
        super().configure(scenario)
        self._read_limits()

    def _read_limits(self) -> None:
        """Take the timeouts and limits of the scenario, for the configured radius and lever."""
        wheels, axes = self.kinematics, axis_limits(self.config.limits)
        rim_speed = self.max_speed * wheels.wheel_radius
        lever = abs(wheels.lever) + self.scenario.robot.swing
        self.drive = Drive(rim_speed, abs(wheels.cross_gain), lever, axes)
        self.commands.sources = sources(self.scenario)
        if "guard" in self.scenario.features:  # which has chosen
            guarded = Source(GUARD_CMD_VEL, self.scenario.command_timeout_s, "guard")
            self.commands.sources = (guarded,)
        self.wheel_timeout_s = self.scenario.wheel_timeout_s

    def reset(self, seed: int) -> None:
        """Set the robot at rest, without a command."""
        del seed
        self.commands.reset()
        self.reference_age_s = math.inf
        """Age of the newest command of any source [s]."""
        self.expired_ticks = 0
        """Number of steps after the first command in which none could be obeyed."""
        self.velocity = self.next_velocity = (LimiterState(), LimiterState(), LimiterState())
        self.begun = False

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the wheel command of a tick."""
        if tick.period_s > 0.0:  # if 0, a newer command replaces the one of this tick
            self._begin(tick, inputs)
        command = self.commands.choose(inputs)
        self.reference_age_s = self.commands.age_s(inputs)
        self.expired_ticks += command is None and self.reference_age_s < math.inf
        wanted = Twist2D() if command is None else command.to_planar()
        self.next_velocity = self.drive.limited(self.velocity, wanted, self.tick_s)
        x, y, yaw = (axis.velocity for axis in self.next_velocity)
        speeds = self.kinematics.inverse(Twist2D(x, y, yaw)).desaturate(self.max_speed)
        header, names = m.Header(stamp=tick.time), self.joints
        return {JOINT_COMMAND: m.JointState(header=header, name=names, velocity=tuple(speeds))}

    def _begin(self, tick: Tick, inputs: Inputs) -> None:
        """Continue from the last command, or from measured motion once the wheels dropped it.

        During missed ticks the wheels held the command. The velocity continues from that command
        and changes by what the limits allow in one tick.
        """
        self.velocity = self.next_velocity
        joins_late = not self.begun and tick.number > 0
        if joins_late or tick.period_s > self.wheel_timeout_s + ROUNDING_S:
            try:
                measured = wheel_speeds(inputs[JOINT_STATES], self.joints)
            except RefusedError:
                measured = WheelSpeeds()  # the odometry node refuses these joint states
            x, y, yaw = map(LimiterState, self.kinematics.forward(measured))
            self.velocity = x, y, yaw
        self.begun = True

    def diagnostics(self) -> dict[str, object]:
        """Return who drives, the age of the newest command, and the ticks without a valid one."""
        drives: dict[str, object] = {"drives": self.commands.driver}
        if math.isinf(self.reference_age_s):
            return drives | {"reference": "none yet"}
        age_s = round(self.reference_age_s, 6)
        return drives | {"reference_age_s": age_s, "expired_ticks": self.expired_ticks}


def wheel_speeds(joints: m.JointState, names: tuple[str, ...]) -> WheelSpeeds:
    """Return the velocities of the wheels' joints [rad/s].

    Raises:
        RefusedError: A wheel joint has no velocity.
    """
    velocities = wheel_values(joints, joints.velocity, names)
    if not velocities:
        known = joints.name[: len(joints.velocity)]
        missing = next(name for name in names if name not in known)
        raise RefusedError(f"joint_states has no velocity of {missing!r}")
    return WheelSpeeds(*velocities)
