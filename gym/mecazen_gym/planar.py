"""Many robots on a plane at once: wheels that roll, with the effects that full physics shows."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.config import Scenario
from mecazen.drive import Drive, MotionLimits, axis_limits
from mecazen.geometry import Twist2D
from mecazen.links import base_link, lump, robot_links
from mecazen.portable import Floats, exp
from mecazen.robot import WHEELS
from mecazen.wheels import MecanumKinematics, WheelSpeeds
from mecazen_physics.motors import real_motors
from mecazen_physics.world import GRAVITY, ground_friction

Ints = npt.NDArray[np.int64]
Axes = tuple[float, ...]
STRAIGHT = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class Effects(NamedTuple):
    """The effects of a robot beyond the controller's limits; the default has none of them."""

    delay_ticks: int = 0
    """Ticks from a wheel command to the wheels' motion."""
    lag_s: float = 0.0
    """Time constant of the wheels."""
    motors: tuple[Axes, ...] = STRAIGHT
    """The twist that the wheels drive by the commanded one (3, 3)."""
    gain: Axes = (1.0, 1.0, 1.0)
    """The robot's twist by that of its wheels, without slip: x, y, yaw."""
    grip: Axes = (math.inf, math.inf, math.inf)
    """Largest accelerations along x, y and in yaw, each by itself, by friction [m/s², rad/s²]."""
    force: Axes = (math.inf, math.inf, math.inf)
    """The same by the motors' torques."""

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Effects:
        """Return the effects of a scenario's robot on its ground."""
        robot, wheels = scenario.robot, scenario.robot.wheels
        configured = MecanumKinematics.from_robot(robot, scenario.controller)
        actual = MecanumKinematics.from_robot(robot)
        radius = actual.wheel_radius / configured.wheel_radius
        arc = math.pi / robot.rollers.count
        fixed = [link for link in robot_links(robot) if link.parent == "base_link"]
        mass, _, inertia = lump([base_link(robot), *fixed])
        along, across = math.sin(robot.roller_angle), math.cos(robot.roller_angle)
        per_newton = along / mass, across / mass, along * abs(actual.lever) / float(inertia[2, 2])
        newton = ground_friction(robot, scenario.world) * mass * GRAVITY
        motors_newton = len(WHEELS) * wheels.max_torque_nm / (wheels.radius_m * along)
        effects = cls(
            # a roller off its lowest position is tilted: docs/physics.md
            gain=(radius, radius * math.sin(arc) / arc, radius * configured.lever / actual.lever),
            grip=tuple(axis * newton for axis in per_newton),
            force=tuple(axis * motors_newton for axis in per_newton),
        )
        motors = real_motors(robot, scenario.physics)
        if motors is None:
            return effects
        driven = []
        for axis in STRAIGHT:
            pairs = zip(motors.gains, configured.inverse(Twist2D(*axis)), strict=True)
            driven.append(configured.forward(WheelSpeeds(*(gain * speed for gain, speed in pairs))))
        return effects._replace(
            delay_ticks=round(motors.delay_s / scenario.sim.tick_s),
            lag_s=motors.time_constant_s,
            motors=tuple(zip(*driven, strict=True)),
        )


class PlanarRobots:
    """The motion of `n` robots of a scenario, from commanded twists to true and measured ones.

    Attributes:
        pose: True poses in world (3, n) [m, m, rad]; yaw is not wrapped.
        measured: Twists by wheel odometry in base_link, without its noise (3, n).
        tick_s: Length of a tick [s].
    """

    def __init__(self, scenario: Scenario, n: int, effects: Effects | None = None) -> None:
        self._effects = effects or Effects.from_scenario(scenario)
        configured = MecanumKinematics.from_robot(scenario.robot, scenario.controller)
        rim_speed = scenario.robot.wheels.max_speed_rad_s * configured.wheel_radius
        axes = axis_limits(scenario.controller.limits)
        drive = Drive(rim_speed, abs(configured.cross_gain), abs(configured.lever), axes)
        self.tick_s = scenario.sim.tick_s
        self._substeps = round(self.tick_s / scenario.physics.dt_s)
        self._limits = MotionLimits(drive, math.inf, self.tick_s, n)
        self._needed = _column([max(axis.acceleration, axis.deceleration) for axis in axes])
        self._start = _column(scenario.start.pose)
        scale = scenario.controller.odometry_scale
        self._scale = _column((scale.x, scale.y, scale.yaw))
        self.pose, self.measured, self._twist = (np.zeros((3, n)) for _ in range(3))
        self._command, self._acceleration, self._wheels = (np.zeros((3, n)) for _ in range(3))
        self._pending = deque(np.zeros((self._effects.delay_ticks, 3, n)))
        self._motors = np.array(self._effects.motors).T[:, :, None]
        self._gain, self._traction = np.ones((3, n)), np.ones((3, n))
        self._kept, self._mean = np.zeros(n), np.zeros(n)
        self.reset(np.arange(n), {})

    def reset(self, envs: Ints, varied: Mapping[str, Floats]) -> None:
        """Place some of the robots, by number (k), at the start, at rest.

        `varied` has factors of their `gain` (3, k), of the ground's `friction` and of their `mass`
        and moment of inertia (k), and a further time constant `lag_s` (k) [s].
        """
        self.pose[:, envs] = self._start
        states = self.measured, self._twist, self._command, self._acceleration, self._wheels
        for state in (*states, *self._pending):
            state[:, envs] = 0.0
        effects = self._effects
        self._gain[:, envs] = _column(effects.gain) * varied.get("gain", 1.0)
        grip = _column(effects.grip) * varied.get("friction", 1.0)
        force = _column(effects.force) / varied.get("mass", 1.0)
        self._traction[:, envs] = np.minimum(grip, force)
        self._has_traction = bool(((self._needed / self._traction).sum(axis=0) > 1.0).any())
        lag_s = np.maximum(effects.lag_s + varied.get("lag_s", 0.0), 1e-9)
        step_s = self.tick_s / self._substeps
        left = [exp(-step_s * (number + 1) / lag_s) for number in range(self._substeps)]
        self._kept[envs], self._mean[envs] = left[-1], sum(left) / self._substeps
        self._has_lag = bool((self._kept > 0.0).any())

    def drive(self, wanted: Floats, poses: Floats) -> None:
        """Drive on the way to wanted twists (3, n), and set the poses after ticks (ticks, 3, n)."""
        aim = self._limits.aim(wanted)
        c, s = np.cos(self.pose[2]), np.sin(self.pose[2])
        for pose in poses:
            self._command, self._acceleration = self._limits.follow(
                self._command, self._acceleration, aim
            )
            c, s = self._move(pose, self._respond(self._command), c, s)
            self.pose = pose
        self.pose = pose.copy()
        self.measured = self._wheels * self._scale

    def _respond(self, command: Floats) -> Floats:
        """Return the robots' mean twists in a tick (3, n), in which their wheels get a command."""
        if self._pending:
            self._pending.append(command)
            command = self._pending.popleft()
        if self._effects.motors != STRAIGHT:
            x, y, yaw = (parts * axis for parts, axis in zip(self._motors, command, strict=True))
            command = x + y + yaw
        mean = command
        if self._has_lag:
            missing = self._wheels - command
            mean, command = command + missing * self._mean, command + missing * self._kept
        self._wheels = command
        twist = mean * self._gain
        if self._has_traction:
            change = twist - self._twist
            share = (np.abs(change) / self._traction).sum(axis=0) / self.tick_s
            slipping = self._twist + change / np.maximum(share, 1.0)
            twist = np.where(share > 1.0, slipping, twist)
        self._twist = twist
        return twist

    def _move(self, pose: Floats, twist: Floats, c: Floats, s: Floats) -> tuple[Floats, Floats]:
        """Set the poses (3, n) after arcs with twists (3, n), given cosine and sine of the yaws.

        Return cosine and sine of the new yaws, by their series: a turn in a tick is small.
        """
        half = twist[2] * (self.tick_s / 2.0)
        square = half * half
        quotient = 1.0 + square * (square / 120.0 - 1.0 / 6.0)
        sine, cosine = half * quotient, 1.0 + square * (square / 24.0 - 0.5)
        middle_c, middle_s = c * cosine - s * sine, s * cosine + c * sine
        quotient *= self.tick_s
        ahead, beside = twist[0] * quotient, twist[1] * quotient
        pose[0] = self.pose[0] + (middle_c * ahead - middle_s * beside)
        pose[1] = self.pose[1] + (middle_s * ahead + middle_c * beside)
        pose[2] = self.pose[2] + 2.0 * half
        return middle_c * cosine - middle_s * sine, middle_s * cosine + middle_c * sine


def _column(values: Sequence[float]) -> Floats:
    return np.array(values)[:, None]


def compose(pose: Floats, inner: Floats) -> Floats:
    """Return poses (3, …) given in the frames of others (3, …), in the frame of those."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    x, y, yaw = inner
    return np.array((pose[0] + c * x - s * y, pose[1] + s * x + c * y, pose[2] + yaw))


def between(pose: Floats, other: Floats) -> Floats:
    """Return other poses (3, …) in the frames of poses (3, …); the inverse of `compose`."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    dx, dy, turn = other - pose
    return np.array((c * dx + s * dy, c * dy - s * dx, turn))


def arc(twist: Floats, time_s: Floats | float) -> Floats:
    """Return poses (3, …) after times with constant twists (3, …), by the heading in between."""
    x, y, turn = twist * time_s
    c, s = np.cos(0.5 * turn), np.sin(0.5 * turn)
    return np.array((c * x - s * y, s * x + c * y, turn))
