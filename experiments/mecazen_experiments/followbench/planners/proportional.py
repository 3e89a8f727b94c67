"""A proportional law towards the place by the target, with or without braking."""

from __future__ import annotations

import math

import numpy as np
from mecazen.geometry import wrap

from mecazen_experiments.followbench.planners.chase import Chase
from mecazen_experiments.followbench.planners.scan import points
from mecazen_experiments.followbench.unicycle import CENTRE, HALF, MAX_V, MAX_W
from mecazen_experiments.followbench.view import View

SPEED_GAIN, TURN_GAIN = 1.0, 2.0
"""Gains of distance and bearing [1/s]."""
NEAR_M = 0.3
"""Distance to the goal below which the robot turns to the goal's heading."""
MARGIN_M, REACTION_S = 0.2, 0.5
"""Gap and time that braking keeps to an obstacle ahead."""


class Proportional:
    """A follower with a proportional law; with `brakes` it slows down for obstacles ahead."""

    def __init__(self, *, brakes: bool) -> None:
        self._brakes = brakes
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Forget the last episode; the planner has no random part."""
        self._chase = Chase()

    def command(self, view: View) -> tuple[float, float]:
        """Return speed [m/s] and yaw rate [rad/s] for the next step."""
        goal = view.robot.between(self._chase.goal(view))
        distance = math.hypot(goal.x, goal.y)
        bearing = math.atan2(goal.y, goal.x) if distance > NEAR_M else goal.yaw
        v = SPEED_GAIN * goal.x
        if view.target is not None:
            c, s = math.cos(view.robot.yaw), math.sin(view.robot.yaw)
            v += c * view.target.vx + s * view.target.vy
        v = max(0.0, min(v, MAX_V))
        if self._brakes:
            v = min(v, max(0.0, (_free(view) - MARGIN_M) / REACTION_S))
        w = TURN_GAIN * wrap(bearing)
        return v, max(-MAX_W, min(w, MAX_W))


def _free(view: View) -> float:
    """Return the free distance straight ahead of the robot [m]."""
    places = points(view) - np.array(view.robot[:2])
    c, s = math.cos(view.robot.yaw), math.sin(view.robot.yaw)
    ahead, beside = c * places[:, 0] + s * places[:, 1], c * places[:, 1] - s * places[:, 0]
    blocking = (np.abs(beside) < HALF[1] + MARGIN_M / 2) & (ahead > 0.0)
    return float(ahead[blocking].min(initial=math.inf)) - (CENTRE + HALF[0])
