"""Many robots on a plane at once: wheels that roll, with the effects that full physics shows."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.config import Scenario
from mecazen.drive import Drive, MotionLimits, axis_limits
from mecazen.geometry import Twist2D
from mecazen.portable import Floats, exp
from mecazen.robot import WHEELS, Robot
from mecazen.wheels import MecanumKinematics, WheelSpeeds
from mecazen_physics.motors import real_motors

GRAVITY = 9.81
"""[m/s²]"""

STRAIGHT = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
"""The wheels' twist by the commanded one, if all motors are alike."""

Ints = npt.NDArray[np.int64]
Axes = tuple[float, float, float]
ONE, NONE = np.ones(1), np.zeros(1)


class Effects(NamedTuple):
    """The effects of a robot beyond the controller's limits; the default has none of them."""

    delay_ticks: int = 0
    """Ticks from a wheel command to the wheels' motion."""
    lag_s: float = 0.0
    """Time constant of the wheels."""
    wheels: tuple[tuple[float, ...], ...] = STRAIGHT
    """The twist that the wheels drive by the commanded one: the motors' gains."""
    gain: Axes = (1.0, 1.0, 1.0)
    """The robot's twist by that of its wheels, without slip: x, y, yaw."""
    grip: Axes = (math.inf, math.inf, math.inf)
    """Largest accelerations along x, y and in yaw, each by itself, by friction [m/s², rad/s²]."""
    force: Axes = (math.inf, math.inf, math.inf)
    """The same by the motors' torques."""

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Effects:
        """Return the effects of a scenario's robot on its ground."""
        robot, tick_s = scenario.robot, scenario.sim.tick_s
        configured = MecanumKinematics.from_robot(robot, scenario.controller)
        actual = MecanumKinematics.from_robot(robot)
        radius = actual.wheel_radius / configured.wheel_radius
        arc = math.pi / robot.rollers.count
        # a roller off its lowest position is tilted: see docs/physics.md
        lateral = radius * math.sin(arc) / arc
        gain = radius, lateral, radius * configured.lever / actual.lever
        friction = scenario.world.ground_friction * robot.rollers.contact_friction
        mass, inertia = mass_and_inertia(robot)
        wheels = robot.wheels
        along, across = math.sin(robot.roller_angle), math.cos(robot.roller_angle)
        x, y, yaw = along / mass, across / mass, along * abs(actual.lever) / inertia
        grip = friction * mass * GRAVITY
        force = len(WHEELS) * wheels.max_torque_nm / (wheels.radius_m * along)
        effects = cls(
            gain=gain,
            grip=(grip * x, grip * y, grip * yaw),
            force=(force * x, force * y, force * yaw),
        )
        motors = real_motors(robot, scenario.physics)
        if motors is None:
            return effects
        columns = []
        for axis in np.eye(3):
            speeds = configured.inverse(Twist2D(*axis.tolist()))
            turned = WheelSpeeds(*(g * s for g, s in zip(motors.gains, speeds, strict=True)))
            columns.append(tuple(configured.forward(turned)))
        return effects._replace(
            delay_ticks=round(motors.delay_s / tick_s),
            lag_s=motors.time_constant_s,
            wheels=tuple(zip(*columns, strict=True)),
        )


def mass_and_inertia(robot: Robot) -> tuple[float, float]:
    """Return mass [kg] and moment of inertia about the z axis of base_link [kg·m²].

    Base and payload are boxes, all other parts points.
    """
    wheel = robot.wheels.hub_mass_kg + robot.rollers.count * robot.rollers.mass_kg
    base = robot.base
    parts = [(wheel, *robot.wheel_position(name)[:2], 0.0, 0.0) for name in WHEELS]
    parts.append((base.mass_kg, 0.0, 0.0, base.length_m, base.width_m))
    parts += [
        (part.mass_kg, *part.position_m[:2], 0.0, 0.0) for part in (robot.camera, robot.lidar)
    ]
    if (load := robot.payload) is not None:
        parts.append((load.mass_kg, *load.position_m[:2], *load.size_m[:2]))
    mass = math.fsum(part[0] for part in parts)
    inertia = math.fsum(m * (x * x + y * y + (a * a + b * b) / 12) for m, x, y, a, b in parts)
    return mass, inertia


class PlanarRobots:
    """The motion of `n` robots of a scenario, from commanded twists to true and measured ones.

    Attributes:
        pose: True poses in world (3, n) [m, m, rad]; yaw is not wrapped.
        measured: Twists by wheel odometry in base_link, without its noise (3, n).
        tick_s: Length of a tick [s].
    """

    def __init__(self, scenario: Scenario, n: int, effects: Effects | None = None) -> None:
        self.effects = Effects.from_scenario(scenario) if effects is None else effects
        configured = MecanumKinematics.from_robot(scenario.robot, scenario.controller)
        rim_speed = scenario.robot.wheels.max_speed_rad_s * configured.wheel_radius
        axes = axis_limits(scenario.controller.limits)
        drive = Drive(rim_speed, abs(configured.cross_gain), abs(configured.lever), axes)
        self.tick_s = scenario.sim.tick_s
        self._substeps = round(self.tick_s / scenario.physics.dt_s)
        self._limits = MotionLimits(drive, math.inf, self.tick_s, n)
        fastest = [max(axis.acceleration, axis.deceleration) for axis in axes]
        self._needed = np.array(fastest)[:, None]
        self._start = np.array(scenario.start.pose)[:, None]
        scale = scenario.controller.odometry_scale
        self._scale = np.array((scale.x, scale.y, scale.yaw))[:, None]
        self.pose, self.measured, self._twist = (np.zeros((3, n)) for _ in range(3))
        self._command, self._acceleration, self._wheels = (np.zeros((3, n)) for _ in range(3))
        self._pending = deque(np.zeros((self.effects.delay_ticks, 3, n)))
        self._gain, self._grip, self._traction = (np.ones((3, n)) for _ in range(3))
        self._kept, self._mean = np.zeros(n), np.zeros(n)
        self.reset(np.arange(n))

    def reset(
        self,
        envs: Ints,
        gain: Floats = ONE,
        friction: Floats = ONE,
        mass: Floats = ONE,
        lag_s: Floats = NONE,
    ) -> None:
        """Place some of the robots at the start, at rest.

        Args:
            envs: Numbers of the robots (k).
            gain: Factors of their gains (3, k).
            friction: Factors of the ground's friction (k).
            mass: Factors of their masses and moments of inertia (k).
            lag_s: Time constants in addition to that of their motors (k) [s].
        """

        def columns(values: tuple[float, ...]) -> Floats:
            return np.array(values)[:, None]

        self.pose[:, envs] = self._start
        for state in (self.measured, self._twist, self._command, self._acceleration, self._wheels):
            state[:, envs] = 0.0
        for state in self._pending:
            state[:, envs] = 0.0
        self._gain[:, envs] = columns(self.effects.gain) * gain
        self._grip[:, envs] = columns(self.effects.grip) * friction
        force = columns(self.effects.force) / mass
        self._traction[:, envs] = np.minimum(self._grip[:, envs], force)
        self._has_traction = bool(((self._needed / self._traction).sum(axis=0) > 1.0).any())
        lag = self.effects.lag_s + lag_s
        share = self.tick_s / self._substeps / np.maximum(lag, 1e-9)
        powers = [exp(-share * (step + 1)) for step in range(self._substeps)]
        self._kept[envs], self._mean[envs] = powers[-1], sum(powers) / self._substeps
        self._has_lag = bool((self._kept > 0.0).any())

    def drive(self, wanted: Floats, ticks: int) -> Floats:
        """Drive for some ticks on the way to wanted twists (3, n); return poses (ticks, 3, n)."""
        poses, aim = np.empty((ticks, *wanted.shape)), self._limits.aim(wanted)
        c, s = np.cos(self.pose[2]), np.sin(self.pose[2])
        for pose in poses:
            self._command, self._acceleration = self._limits.follow(
                self._command, self._acceleration, aim
            )
            c, s = self._move(pose, self._respond(self._command), c, s)
            self.pose = pose
        self.measured = self._wheels * self._scale
        return poses

    def _respond(self, command: Floats) -> Floats:
        """Return the robots' mean twists in a tick (3, n), in which their wheels get a command."""
        if self._pending:
            self._pending.append(command)
            command = self._pending.popleft()
        if self.effects.wheels != STRAIGHT:
            command = np.einsum("ij,jn->in", np.array(self.effects.wheels), command)
        mean = command
        if self._has_lag:
            missing = self._wheels - command
            mean, command = command + missing * self._mean, command + missing * self._kept
        self._wheels = command
        twist = mean * self._gain
        if self._has_traction:
            change = twist - self._twist
            share = (np.abs(change) / self._traction).sum(axis=0) / self.tick_s
            self._twist = twist = self._twist + change / np.maximum(share, 1.0)
        return twist

    def _move(self, pose: Floats, twist: Floats, c: Floats, s: Floats) -> tuple[Floats, Floats]:
        """Set the poses (3, n) after arcs with twists (3, n), given cosine and sine of the yaws.

        Return cosine and sine of the new yaws. Their quotients with the turn are series: a turn in
        a tick is below 0.1 rad.
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
