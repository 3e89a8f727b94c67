"""The dynamic window of Follow-Bench: the best command for one step ahead.

Fox, Burgard & Thrun, The dynamic window approach to collision avoidance, IEEE Robotics &
Automation Magazine 4(1), 1997, with the weights and the horizon of Follow-Bench's planner.
"""

from __future__ import annotations

import math

import numpy as np
from mecazen.portable import Floats, arctan2

from mecazen_experiments.followbench.pedestrians import STEP_S
from mecazen_experiments.followbench.planners.chase import Chase
from mecazen_experiments.followbench.planners.scan import points
from mecazen_experiments.followbench.unicycle import MAX_V, MAX_W
from mecazen_experiments.followbench.view import View

SPEEDS_M_S, TURNS_RAD_S = 0.01 * MAX_V, 0.01 * MAX_W
"""Spacing of sampled commands."""
HEADING, OBSTACLE, SPEED = 3.0, 0.1, 1.0
"""Weights of the costs, each scaled to 0 … 1."""
CLEARANCE_M = 0.445 + 0.6
"""Sum of the radii of the robot and of an obstacle point."""
TARGET_M = 0.5
"""A point nearer to the target than this is the target."""
CREEP_M_S = 0.1
"""Speed at which the robot turns if every command is blocked."""
STANDING_M_S = 0.01


class Window:
    """A follower that takes the best command of its dynamic window."""

    def __init__(self) -> None:
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget the last episode, and seed the direction of turns on the spot."""
        self._chase = Chase()
        self._random = np.random.Generator(np.random.PCG64(seed))

    def command(self, view: View) -> tuple[float, float]:
        """Return speed [m/s] and yaw rate [rad/s] for the next step."""
        goal, robot = self._chase.goal(view), view.robot
        speeds = _window(view.v, MAX_V, SPEEDS_M_S)
        turns = _window(view.w, MAX_W, TURNS_RAD_S)
        x = robot.x + STEP_S * math.cos(robot.yaw) * speeds
        y = robot.y + STEP_S * math.sin(robot.yaw) * speeds
        gap = self._gap(view, x, y)
        free = gap > 0.0
        if not free.any():
            return CREEP_M_S, MAX_W if self._random.random() > 0.5 else -MAX_W
        speeds, x, y, gap = speeds[free], x[free], y[free], gap[free]
        bearing = arctan2(goal.y - y, goal.x - x) - robot.yaw
        off = np.abs(bearing[:, None] - STEP_S * turns)
        off = np.minimum(off % math.tau, math.tau - off % math.tau)
        near = np.where(np.isinf(gap), 0.0, 1.0 / np.maximum(gap, 1e-6))
        slow = MAX_V - speeds
        cost = HEADING * _scaled(off)
        cost += (OBSTACLE * _scaled(near) + SPEED * _scaled(slow))[:, None]
        i, j = divmod(int(cost.argmin()), len(turns))
        v, w = float(speeds[i]), float(turns[j])
        stuck = abs(v) < STANDING_M_S and abs(view.v) < STANDING_M_S
        return v, -MAX_W if stuck else w

    def _gap(self, view: View, x: Floats, y: Floats) -> Floats:
        """Return the gap to the nearest obstacle for a robot at positions (n); inf if none."""
        obstacles = points(view)
        last = self._chase.last
        if last is not None:
            off = np.hypot(obstacles[:, 0] - last.x, obstacles[:, 1] - last.y)
            obstacles = obstacles[off > TARGET_M]
        people = np.array([person[:2] for person in view.people]).reshape(-1, 2)
        obstacles = np.concatenate((obstacles, people))
        dx, dy = x[:, None] - obstacles[:, 0], y[:, None] - obstacles[:, 1]
        gap: Floats = np.hypot(dx, dy).min(axis=1, initial=math.inf) - CLEARANCE_M
        return gap


def _window(now: float, limit: float, distance: float) -> Floats:
    """Return the commands that are reachable in a step, and those between them and rest.

    The limits of acceleration in m/s² and rad/s² have the same numbers as those of the commands.
    """
    low = min(max(-limit, now - limit * STEP_S), 0.0)
    high = max(min(limit, now + limit * STEP_S), 0.0)
    return np.linspace(low, high, int((high - low) / distance) + 1)


def _scaled(cost: Floats) -> Floats:
    low, high = float(cost.min()), float(cost.max())
    scaled: Floats = (cost - low) / (high - low) if high > low else np.zeros_like(cost)
    return scaled
