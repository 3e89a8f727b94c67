"""The planner: model predictive path integral control (MPPI) about the polar law.

G. Williams, A. Aldrich & E. A. Theodorou, Model predictive path integral control: from theory to
parallel computation, J. Guid. Control Dyn. 40(2), 2017. Samples v = u + ε of nominal commands u
with ε ~ N(0, Σ) have the costs S(v); the new commands are Σ w v with the weights

    w = exp(-(S(v) - min S) / λ) / Σ exp(-(S(v) - min S) / λ).

Each of several nominal paths is sampled separately, since a mean of paths on both sides of a pillar
leads into the pillar. The cheapest of all nominal paths and means is taken.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from functools import lru_cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from mecazen.config import FollowerConfig
from mecazen.config.follower import PolarControl
from mecazen.drive import Array, Drive, MotionLimits
from mecazen.geometry import Pose2D, Standoff, Twist2D, rotate, wrap
from mecazen.messages import LaserScan
from mecazen.portable import Floats, arctan2, exp

from mecazen_follower.control import HEADING_BRAKING_RAD_S2, LINEAR_BRAKING_M_S2
from mecazen_follower.estimators import Estimate
from mecazen_follower.planner.costs import OPEN, Costs, Extents, Rollout, Situation
from mecazen_follower.planner.surroundings import LocalMap, Shadows
from mecazen_follower.sight import FieldOfView

PERIOD_S, HORIZON_S = 0.05, 2.5
"""Time between plans, and time that a plan looks ahead [s]."""
STEPS = 20
KNOTS = 6
"""Number of random values; the noise is piecewise linear between them."""
NOISE = 0.5, 0.5, 0.8
"""Standard deviations of the noise: the root of Σ [m/s, m/s, rad/s]."""
FINE = 0.25
"""Factor on the noise of every second sample."""
TEMPERATURE = 0.5
"""λ, the difference of costs by which a sample's weight falls to 1/e."""
LOYALTY = 0.5
"""A path must be cheaper by this cost to replace the last plan."""
POINT_M = 0.05
"""Half the width that an obstacle point hides [m]."""
TRAIL_M, TRAIL_BEHIND_M = 0.1, 3.0
"""Spacing of the points of the person's trail, and its length beyond the standoff [m]."""
ASIDE = math.radians(45.0)
"""Angle about the person between the place to keep and its neighbours [rad]."""
ALIKE = math.radians(5.0)
"""Places whose bearings differ by less than this are the same [rad]."""

Command = Callable[[int, Array, Array, Array], Array]
"""Maps a step and x, y and yaw, each (n), to velocities along odom's axes and yaw rates (3, n)."""


class Prediction(NamedTuple):
    """Predicted poses and velocities after each step: (steps, 3), or (steps, 3, n) for n goals.

    The origin is the robot, the axes are those of odom.
    """

    poses: Floats
    velocities: Floats


class Planner:
    """Plans every `PERIOD_S`; between plans the last plan is followed.

    Args:
        config: The follower's configuration, with a planner.
        drive: Limits of wheels and controller.
        body: Sizes of robot and person.
        view: Field of view of the sensor that sees the person.
        seed: Seed of the samples; they are the same at each plan.
    """

    def __init__(
        self,
        config: FollowerConfig,
        drive: Drive,
        body: Extents,
        view: FieldOfView,
        seed: int,
    ) -> None:
        self._body, self._view = body, view
        self.configure(config, drive)
        self._noise = noise(self._config.samples, seed)
        self.forget()

    def configure(self, config: FollowerConfig, drive: Drive) -> None:
        assert config.planner is not None
        self._config, self._standoff = config.planner, config.standoff
        self._law = config.control if isinstance(config.control, PolarControl) else PolarControl()
        self._drive, self._dt = drive, HORIZON_S / STEPS
        limits = partial(MotionLimits, drive, self._law.max_speed_m_s, self._dt)
        self._limits = lru_cache(limits)
        self.costs = Costs(self._config, self._standoff, self._body, self._view)

    def forget(self) -> None:
        """Forget everything, since odom has changed."""
        self.clear_plan()
        self._map = LocalMap()
        self._trail: deque[tuple[float, float]] = deque()
        """The person's past positions in odom, oldest first."""
        self._person: Estimate | None = None
        self._time = 0.0
        """Time of the person's estimate [s]."""

    def clear_plan(self) -> None:
        """Drop the plan: the robot stands, or turns on the spot."""
        self.plan = OPEN
        """The current plan, with its reason."""
        self._commands: Array | None = None
        self._sent = Twist2D()
        self._planned = -math.inf
        self._yaw = 0.0

    def see(self, time: float, scan: LaserScan, lidar: Pose2D) -> None:
        """Update with a scan captured at `time` [s] with the lidar at a pose in odom.

        Before the person is known, scans are ignored: the person's legs would count as obstacles.
        """
        if self._person is not None:
            self._map.see(time, scan, lidar, self._person.after(time - self._time).pose)

    def command(
        self, time: float, dt: float, person: Estimate, robot: Pose2D, nominal: Twist2D
    ) -> Twist2D:
        """Return the twist in base_link: `nominal`, unchanged, if no obstacle is near.

        `person` and `robot` are those of `time` [s], at which the robot responds to the command.
        """
        self._person, self._time = person, time
        place = person.pose.x, person.pose.y
        if not self._trail or math.dist(self._trail[-1], place) >= TRAIL_M:
            self._trail.append(place)
        while len(self._trail) > round((self._standoff.distance + TRAIL_BEHIND_M) / TRAIL_M):
            self._trail.popleft()
        if time - self._planned > PERIOD_S - 1e-6:
            elapsed = time - self._planned
            self._planned = time
            self._replan(time, elapsed, person, robot)
        if self._commands is None:
            self._sent = nominal
            return nominal
        x, y, yaw = self._commands[0].tolist()
        twist = Twist2D(*rotate(x, y, -robot.yaw), yaw)
        self._sent = self._drive.step(self._sent, twist, self._law.max_speed_m_s, dt)
        return self._sent

    def search(self, nominal: Array, situation: Situation) -> tuple[Rollout, Array]:
        """Return paths (n) and their costs: each nominal path, and the mean of its samples.

        Args:
            nominal: Commands (STEPS, 3, modes) about which to sample.
            situation: The person, obstacles and walkers ahead.
        """
        modes, samples = nominal.shape[-1], self._noise.shape[-1]
        ends = np.arange(modes + 1) * samples // modes
        commands = np.repeat(nominal.astype(np.float32), np.diff(ends), axis=-1)
        commands += self._noise
        costs = self.costs.evaluate(self.roll(commands), situation)
        means = np.empty_like(nominal)
        for mode, (begin, end) in enumerate(pairwise(ends.tolist())):
            weights = exp((costs[begin:end].min() - costs[begin:end]) / TEMPERATURE)
            weights /= weights.sum()
            means[..., mode] = np.einsum("kan,n->ka", commands[..., begin:end], weights)
        paths = self.roll(np.concatenate((nominal, means), axis=-1))
        costs = self.costs.evaluate(paths, situation)
        if self._commands is not None:  # the last mode is the last plan
            costs[[modes - 1, -1]] -= LOYALTY
        return paths, costs

    def roll(self, commands: Array) -> Rollout:
        """Return the paths of commands (STEPS, 3, n) from the robot's present motion."""
        limits = self._limits(commands.shape[-1], commands.dtype)
        return roll(self._yaw, self._sent, len(commands), limits, lambda k, *_: commands[k])

    def _replan(self, time: float, elapsed: float, person: Estimate, robot: Pose2D) -> None:
        """Plan at `time` [s], `elapsed` [s] after the last plan."""
        self._yaw = robot.yaw
        later = [person.after(self._dt * (k + 1)) for k in range(STEPS)]
        poses = np.array([estimate.pose for estimate in later]) - (robot.x, robot.y, 0.0)
        predicted = Prediction(poses, np.array([estimate.velocity for estimate in later]))
        trail = np.array(self._trail).reshape(-1, 2) - robot[:2]
        goals, turns = goals_of(self._standoff, predicted, trail)
        law = towards(poses, goals, turns, self._law)
        limits = self._limits(len(turns))
        paths = roll(robot.yaw, self._sent, STEPS, limits, law)
        situation = self._situation(time, poses, goals.poses[..., 0], robot)
        first = Rollout(*(values[..., :1] for values in paths))
        is_evading = self._commands is not None
        obstacle = self.costs.blocked(first, situation, self._dt, evades=is_evading)
        if not obstacle:
            self.plan, self._commands = OPEN, None
            return
        nominal = paths.commands
        if self._commands is not None:
            last = shifted(self._commands, elapsed / self._dt)
            nominal = np.concatenate((nominal, last[..., None]), axis=-1)
        paths, costs = self.search(nominal, situation)
        best = Rollout(*(values[..., [int(np.argmin(costs))]] for values in paths))
        self._commands = best.commands[..., 0]
        self.plan = self.costs.plan(best, situation, obstacle, self.plan.state)

    def _situation(self, time: float, person: Floats, goals: Floats, robot: Pose2D) -> Situation:
        standing = self._map.standing(robot) - robot[:2]
        walkers = self._map.walkers(time + self._dt * np.arange(1.0, STEPS + 1.0)) - robot[:2]
        points = np.concatenate(
            (np.broadcast_to(standing, (STEPS, *standing.shape)), walkers), axis=1
        )
        radius = np.repeat((POINT_M, self._body.person), (len(standing), walkers.shape[1]))
        shadows = Shadows(person[:, :2], points, radius)
        return Situation(person, goals, walkers, standing, shadows)


def noise(samples: int, seed: int) -> Array:
    """Return random deviations of commands (STEPS, 3, samples), piecewise linear in time."""
    random = np.random.Generator(np.random.PCG64(seed))
    knots = random.standard_normal((KNOTS, 3, samples)) * np.array(NOISE)[:, None]
    at = np.linspace(0.0, KNOTS - 1.0, STEPS)
    before = np.minimum(at.astype(int), KNOTS - 2)
    share = (at - before)[:, None, None]
    deviations = (1.0 - share) * knots[before] + share * knots[before + 1]
    deviations[..., 1::2] *= FINE
    result: Array = deviations.astype(np.float32)
    return result


def shifted(commands: Array, steps: float) -> Array:
    """Return the remainder of a plan (n, 3) whose first command was due `steps` ago (n, 3).

    The last command is repeated at the end.
    """
    known = np.arange(len(commands))
    return np.stack([np.interp(known + steps, known, axis) for axis in commands.T], axis=-1)


def roll(yaw: float, twist: Twist2D, steps: int, limits: MotionLimits, command: Command) -> Rollout:
    """Return the motion of robots that start at the origin with a yaw [rad] and a twist.

    A step leads along the mean of the directions at its ends.
    """
    n, dt, dtype = limits.n, limits.dt, limits.dt.dtype
    x, y, angle = np.zeros(n, dtype), np.zeros(n, dtype), np.full(n, yaw, dtype)
    twists = np.repeat(np.array(twist, dtype)[:, None], n, axis=1)
    c, s = np.cos(angle), np.sin(angle)
    poses, commands = np.empty((4, steps, n), dtype), np.empty((steps, 3, n), dtype)
    desired, half = np.empty_like(twists), dtype.type(0.5)
    for k in range(steps):
        commands[k] = command(k, x, y, angle)
        vx, vy, desired[2] = commands[k]
        desired[0], desired[1] = c * vx + s * vy, c * vy - s * vx
        reached = limits.step(twists, desired)
        dx, dy, turn = limits.mean(twists, reached) * dt
        angle = angle + turn
        last_c, last_s = c, s
        c, s = np.cos(angle), np.sin(angle)
        mean_c, mean_s = (last_c + c) * half, (last_s + s) * half
        x = x + mean_c * dx - mean_s * dy
        y = y + mean_s * dx + mean_c * dy
        poses[:, k] = x, y, c, s
        twists = reached
    return Rollout(poses[0], poses[1], poses[2], poses[3], commands)


def goals_of(standoff: Standoff, person: Prediction, trail: Floats) -> tuple[Prediction, Floats]:
    """Return the goals of n modes, and the yaw rate (n) at which each orbits the person.

    The modes are the place to keep, others around the person, the person's trail, and staying. In
    all modes the robot sees the person at the same angle as from the place to keep.

    Args:
        standoff: The place to keep.
        person: The person's prediction.
        trail: The person's past positions (m, 2), oldest first [m].
    """
    behind, mirrored = wrap(math.pi - standoff.bearing), wrap(-2.0 * standoff.bearing)
    turns = [0.0]
    for turn in (behind, ASIDE, -ASIDE, mirrored):
        if all(abs(wrap(turn - known)) > ALIKE for known in turns):
            turns.append(turn)
    steps, modes = len(person.poses), len(turns) + 2
    poses, velocities = np.zeros((steps, 3, modes)), np.zeros((steps, 3, modes))
    facing = standoff.heading - standoff.bearing  # relative to person→robot
    direction = person.poses[:, 2:] + (standoff.bearing + np.array(turns))
    reach = standoff.distance * np.stack((np.cos(direction), np.sin(direction)), axis=1)
    poses[:, :2, :-2] = person.poses[:, :2, None] + reach
    poses[:, 2, :-2] = direction + facing
    yaw_rate = person.velocities[:, 2:]
    velocities[:, 0, :-2] = person.velocities[:, :1] - yaw_rate * reach[:, 1]
    velocities[:, 1, :-2] = person.velocities[:, 1:2] + yaw_rate * reach[:, 0]
    velocities[:, 2, :-2] = yaw_rate

    # the trail; and staying, at the origin
    poses[:, :2, -2], velocities[:, :2, -2] = _along(trail, person, standoff.distance)
    off = poses[:, :2, -2:] - person.poses[:, :2, None]
    poses[:, 2, -2:] = arctan2(off[:, 1], off[:, 0]) + facing
    orbits = np.zeros(modes)
    orbits[:-2] = yaw_rate[0]
    return Prediction(poses, velocities), orbits


def _along(trail: Floats, person: Prediction, distance: float) -> tuple[Floats, Floats]:
    """Return points at a distance behind the person along the path, and their velocities."""
    path = np.concatenate((trail, person.poses[:, :2]))
    lengths = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))))
    speeds = np.hypot(person.velocities[:, 0], person.velocities[:, 1])
    at = np.maximum(lengths[len(trail) :] - distance, 0.0)
    points = np.stack([np.interp(at, lengths, axis) for axis in path.T], axis=-1)
    ahead = np.stack([np.interp(at + 0.1, lengths, axis) for axis in path.T], axis=-1)
    dx, dy = (ahead - points).T
    length = np.maximum(np.hypot(dx, dy), 1e-6)
    return points, (ahead - points) * (speeds / length)[:, None]


def towards(person: Floats, goals: Prediction, orbits: Floats, law: PolarControl) -> Command:
    """Return the law of control.py for n goals, without wheel limits: `MotionLimits` applies them.

    Args:
        person: The person's predicted poses (steps, 3).
        goals: The goals (steps, 3, n).
        orbits: The yaw rate (n) at which each goal orbits the person [rad/s].
        law: Gains and limits of the law.
    """
    n = goals.poses.shape[-1]
    gain, twice_braking = (
        np.repeat(np.array(values)[:, None], n, axis=1)
        for values in (
            (law.linear_gain_1_s, law.linear_gain_1_s, law.heading_gain_1_s),
            (2.0 * LINEAR_BRAKING_M_S2, 2.0 * LINEAR_BRAKING_M_S2, 2.0 * HEADING_BRAKING_RAD_S2),
        )
    )
    reaches = goals.poses[:, :2] - person[:, :2, None]
    lengths = np.hypot(reaches[:, 0], reaches[:, 1])
    # velocity of the person only; the turn about the person is added at the robot's distance
    turned = orbits * reaches
    along_x, along_y = goals.velocities[:, 0] + turned[:, 1], goals.velocities[:, 1] - turned[:, 0]

    def command(k: int, x: Array, y: Array, yaw: Array) -> Array:
        (reach_x, reach_y), with_x, with_y = reaches[k], along_x[k], along_y[k]
        offset_x, offset_y = x - person[k, 0], y - person[k, 1]
        distance = np.maximum(np.hypot(offset_x, offset_y), 1e-6)
        ux, uy = offset_x / distance, offset_y / distance
        off = arctan2(ux * reach_y - uy * reach_x, ux * reach_x + uy * reach_y)
        turn = goals.poses[k, 2] - yaw
        turn -= math.tau * np.rint(turn / math.tau)
        error = np.array((lengths[k] - distance, distance * off, turn))
        size = np.abs(error)
        rate = np.copysign(np.minimum(gain * size, np.sqrt(twice_braking * size)), error)
        away = ux * with_x + uy * with_y + rate[0]
        around = ux * with_y - uy * with_x + orbits * distance + rate[1]
        turn = goals.velocities[k, 2] + rate[2]
        turn = np.minimum(np.maximum(turn, -law.max_yaw_rate_rad_s), law.max_yaw_rate_rad_s)
        return np.array((ux * away - uy * around, uy * away + ux * around, turn))

    return command
