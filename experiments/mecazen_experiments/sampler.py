"""A sampler of constant velocities, for comparison with the planner.

The sampler is a dynamic window (D. Fox, W. Burgard, S. Thrun, The dynamic window approach to
collision avoidance, IEEE Robot. Autom. Mag. 4(1), 1997), as in the planners DWA and DWB of ROS:
each twist is driven for the whole horizon within the limits of the robot. It uses the costs of our
planner.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from mecazen.drive import Array
from mecazen_follower.node import FollowerNode
from mecazen_follower.planner.mppi import STEPS, Problem
from mecazen_follower.planner.rollout import Rollout

SPEEDS_M_S = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.3)
DIRECTIONS = 16
TURNS_RAD_S = (-2.0, -1.2, -0.6, -0.2, 0.0, 0.2, 0.6, 1.2, 2.0)


class Window:
    """Twists along odom's axes, each constant."""

    def __init__(self) -> None:
        headings = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False)
        twists = [
            (speed * np.cos(heading), speed * np.sin(heading), turn)
            for speed, heading, turn in product(SPEEDS_M_S, headings, TURNS_RAD_S)
        ]
        self._commands = np.tile(np.array(twists, np.float32).T, (STEPS, 1, 1))

    def plan(self, problem: Problem) -> tuple[Rollout, Array]:
        """Return all paths and their costs, independent of the nominal paths."""
        ways = problem.roll(self._commands)
        return ways, problem.cost(ways)


class SamplerFollower(FollowerNode):
    """Our follower, whose planner samples constant velocities."""

    def reset(self, seed: int) -> None:
        """Begin a run."""
        super().reset(seed)
        if self.following.planner is not None:
            self.following.planner.search = Window().plan
