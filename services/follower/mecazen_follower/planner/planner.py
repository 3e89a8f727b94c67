"""The following planner: the polar law if no obstacle is near, otherwise the best path round it."""

from __future__ import annotations

import math
from functools import lru_cache, partial

import numpy as np
from mecazen.config import FollowerConfig
from mecazen.config.follower import PolarControl
from mecazen.drive import Array, Drive, MotionLimits
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.messages import LaserScan
from mecazen.portable import Floats

from mecazen_follower.estimators import Estimate
from mecazen_follower.planner.costs import Costs, Extents, Sight, Situation
from mecazen_follower.planner.field import Shadows
from mecazen_follower.planner.law import towards
from mecazen_follower.planner.modes import Prediction, Trail, goals_of
from mecazen_follower.planner.mppi import STEPS, Mppi, Problem, Search
from mecazen_follower.planner.obstacles import Surroundings
from mecazen_follower.planner.rollout import Rollout, follow, roll
from mecazen_follower.planner.verdict import OPEN, free, verdict

POINT_M = 0.05
"""Half the width that an obstacle point hides [m]."""


class Planner:
    """Plans at `rate_hz`; between plans the last plan is followed.

    Args:
        config: The follower's configuration, with a planner.
        drive: Limits of wheels and controller.
        body: Sizes of robot and person.
        sight: Field of view of the sensor that sees the person.
        seed: Seed of the samples.

    Attributes:
        plan: The current plan, with its reason.
        search: The search for the best path.
    """

    def __init__(
        self, config: FollowerConfig, drive: Drive, body: Extents, sight: Sight, seed: int
    ) -> None:
        self._body, self._sight = body, sight
        self.configure(config, drive)
        self.search: Search = Mppi(self._config.samples, seed).plan
        self.forget()

    def configure(self, config: FollowerConfig, drive: Drive) -> None:
        """Continue with changed priorities, limits or standoff."""
        assert config.planner is not None
        self._config, self._standoff = config.planner, config.standoff
        self._law = config.control if isinstance(config.control, PolarControl) else PolarControl()
        self._drive, self._dt = drive, self._config.horizon_s / STEPS
        limits = partial(MotionLimits, drive, self._law.max_speed_m_s, self._dt)
        self._limits = lru_cache(limits)
        place, clearance = self._standoff.distance, self._config.clearance_m
        self._costs = Costs(self._config.priorities, place, clearance, self._body, self._sight)

    def forget(self) -> None:
        """Forget everything, since odom has changed."""
        self.rest()
        self.surroundings = Surroundings()
        self._trail = Trail()
        self._person: Estimate | None = None
        self._time = 0.0
        """Time of the person's estimate [s]."""

    def rest(self) -> None:
        """Drop the plan: the robot stands, or turns on the spot."""
        self.plan = OPEN
        self._commands: Array | None = None
        self._sent = Twist2D()
        self._planned = -math.inf

    def see(self, time: float, scan: LaserScan, lidar: Pose2D) -> None:
        """Update with a scan captured at `time` [s] with the lidar at a pose in odom.

        Before the person is known, scans are ignored: the person's legs would count as obstacles.
        """
        if self._person is not None:
            person = self._person.after(time - self._time)
            self.surroundings.see(time, scan, lidar, person.pose)

    def command(
        self, time: float, dt: float, person: Estimate, robot: Pose2D, nominal: Twist2D
    ) -> Twist2D:
        """Return the twist in base_link: `nominal`, unchanged, if no obstacle is near.

        `person` and `robot` are those of `time` [s], at which the robot responds to the command.
        """
        self._person, self._time = person, time
        self._trail.add(person.pose, self._standoff.distance)
        if time - self._planned > 1.0 / self._config.rate_hz - 1e-6:
            elapsed = time - self._planned
            self._planned = time
            self.replan(time, elapsed, person, robot)
        if self._commands is None:
            self._sent = nominal
            return nominal
        x, y, yaw = self._commands[0].tolist()
        wanted = Twist2D(*rotate(x, y, -robot.yaw), yaw)
        self._sent = self._drive.step(self._sent, wanted, self._law.max_speed_m_s, dt)
        return self._sent

    def replan(self, time: float, elapsed: float, person: Estimate, robot: Pose2D) -> None:
        """Plan at `time` [s], `elapsed` [s] after the last plan."""
        prediction = Prediction.of(person, robot, STEPS, self._dt)
        goals = goals_of(self._standoff, prediction, self._trail.points(robot))
        nominal = roll(
            robot.yaw,
            self._sent,
            STEPS,
            self._limits(goals.poses.shape[-1]),
            towards(prediction.poses, goals, self._law),
        )
        standing = self.surroundings.standing(robot) - robot[:2]
        times: Floats = time + self._dt * np.arange(1.0, STEPS + 1.0)
        movers = self.surroundings.walkers(times) - robot[:2]
        shadows = self._shadows(prediction.poses[:, :2], standing, movers)
        was = self._config.clearance_m
        wanted = was if self._commands is None else 1.5 * was  # hysteresis: return to the law late
        obstacle = free(
            nominal, standing, movers, self._body, prediction, shadows, wanted, self._dt
        )
        if not obstacle:
            self.plan, self._commands = OPEN, None
            return
        scene = Situation(prediction.poses, goals.poses[..., 0], movers, standing, shadows)
        modes = nominal.commands
        if self._commands is not None:
            modes = np.concatenate((modes, _shifted(self._commands, elapsed / self._dt)), axis=-1)

        def rolled(commands: Array) -> Rollout:
            limits = self._limits(commands.shape[-1], commands.dtype)
            return roll(robot.yaw, self._sent, STEPS, limits, follow(commands))

        loyal = self._commands is not None
        cost = partial(self._costs.of, scene=scene)
        best, costs = self.search(Problem(modes, rolled, cost, loyal))
        chosen = int(np.argmin(costs))
        way = Rollout(*(values[..., [chosen]] for values in best))
        self._commands = way.commands[..., 0]
        self.plan = verdict(way, scene, self._costs, self._standoff, obstacle, self.plan.state)

    def _shadows(self, person: Floats, standing: Floats, movers: Floats) -> Shadows:
        points = np.concatenate(
            (np.broadcast_to(standing, (STEPS, *standing.shape)), movers), axis=1
        )
        radius = np.repeat((POINT_M, self._body.person), (len(standing), movers.shape[1]))
        return Shadows(person, points, radius)


def _shifted(commands: Array, steps: float) -> Array:
    """Return the rest of a plan (n, 3) whose first command was due `steps` ago (n, 3, 1).

    The last command is repeated at the end.
    """
    at = np.arange(len(commands)) + steps
    known = np.arange(len(commands))
    return np.stack([np.interp(at, known, axis) for axis in commands.T], axis=-1)[..., None]
