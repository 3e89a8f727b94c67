"""The social-force follower of Follow-Bench: the reference whose results are published.

A driving force towards the goal and exponential repulsions (Helbing & Molnár, Phys. Rev. E 51,
1995) change the velocity of a point at the axle; a unicycle then turns into this velocity. The
formulas and parameters are those of Follow-Bench's planner, including two peculiarities that affect
its results. Clusters of the scan repel as obstacles although some are people. The direction vectors
from clusters are divided by the norm of all vectors together.
"""

from __future__ import annotations

import math

import numpy as np
from mecazen.geometry import wrap
from mecazen.portable import Floats, exp

from mecazen_experiments.followbench.pedestrians import STEP_S
from mecazen_experiments.followbench.planners.chase import Chase
from mecazen_experiments.followbench.planners.scan import center, clusters, points
from mecazen_experiments.followbench.view import View

SPEED_M_S = 3.0
"""Desired and maximum speed; the robot's own limit is 2 m/s."""
GAIN = 1.3
"""Gain of the driving force [1/s]."""
ARRIVED_M = 0.7
"""Distance to the goal below which the desired speed is 0."""
SAFE_M = 0.3
PEOPLE, THINGS = (7.0, 0.5), (10.0, 0.5)
"""Strength [m/s²] and reach [m] of the repulsion by people and by clusters of the scan."""
THINGS_M = 5.0
"""Distance beyond which clusters do not repel."""
TARGET_M = 0.5
"""A cluster nearer to the target than this is the target."""
STILL_M = 0.05
"""The robot stops if the distance to the goal and the goal's last motion are below this."""
TURN_RAD_S, TURN_S, ALIGNED_RAD, SLOW_M_S = 2.0, 0.2, 0.1, 0.02
"""Maximum yaw rate, time of a turn, angle below which no turn is needed, speed that counts as 0."""


class Social:
    """A follower driven by social forces."""

    def __init__(self) -> None:
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget the last episode; nothing is drawn at random."""
        self._chase = Chase()
        self._goal: tuple[float, float] | None = None

    def command(self, view: View) -> tuple[float, float]:
        """Return speed [m/s] and yaw rate [rad/s] for the next step."""
        goal, robot = self._chase.goal(view), view.robot
        x, y = goal.x - robot.x, goal.y - robot.y
        distance = math.hypot(x, y)
        vx, vy = view.v * math.cos(robot.yaw), view.v * math.sin(robot.yaw)
        wanted = SPEED_M_S / distance if distance > ARRIVED_M else 0.0
        push_x, push_y = self._push(view)
        vx += STEP_S * (GAIN * (wanted * x - vx) + push_x)
        vy += STEP_S * (GAIN * (wanted * y - vy) + push_y)
        scale = min(1.0, SPEED_M_S / max(math.hypot(vx, vy), 1e-9))
        last, self._goal = self._goal, (goal.x, goal.y)
        if last is not None and max(math.dist(last, self._goal), distance) < STILL_M:
            return 0.0, 0.0
        return unicycle(robot.yaw, scale * vx, scale * vy)

    def _push(self, view: View) -> tuple[float, float]:
        """Return the repulsion [m/s²] from visible people and from clusters of the scan."""
        place = np.array(view.robot[:2])
        away = place - np.array([person[:2] for person in view.people]).reshape(-1, 2)
        ranges = np.hypot(away[:, 0], away[:, 1])
        x, y = _repulsion(away / ranges[:, None], ranges, *PEOPLE)
        last = self._chase.last
        middles = [center(group) for group in clusters(points(view))]
        if last is not None:
            middles = [middle for middle in middles if math.dist(middle, last[:2]) > TARGET_M]
        away = place - np.array(middles).reshape(-1, 2)
        ranges = np.hypot(away[:, 0], away[:, 1])
        away, ranges = away[ranges < THINGS_M], ranges[ranges < THINGS_M]
        norm = math.sqrt(math.fsum((ranges * ranges).tolist()))
        things_x, things_y = _repulsion(away / max(norm, 1e-9), ranges, *THINGS)
        return x + things_x, y + things_y


def _repulsion(away: Floats, ranges: Floats, strength: float, reach: float) -> tuple[float, float]:
    forces = strength * exp((SAFE_M - ranges) / reach)[:, None] * away
    return math.fsum(forces[:, 0].tolist()), math.fsum(forces[:, 1].tolist())


def unicycle(yaw: float, vx: float, vy: float) -> tuple[float, float]:
    """Return speed and yaw rate that turn a unicycle into a velocity, without backing up."""
    speed = math.hypot(vx, vy)
    if speed <= SLOW_M_S:
        return 0.0, 0.0
    off = wrap(math.atan2(vy, vx) - yaw)
    turn = 0.0 if abs(off) < ALIGNED_RAD else max(-TURN_RAD_S, min(TURN_RAD_S, off / TURN_S))
    return max(speed * math.cos(off), 0.0), turn
