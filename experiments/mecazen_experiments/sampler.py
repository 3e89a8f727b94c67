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
from mecazen_follower.node import FollowerNode, data_sheet, make_planner
from mecazen_follower.planner.costs import Rollout, Situation
from mecazen_follower.planner.mppi import STEPS, Planner

SPEEDS_M_S = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.3)
DIRECTIONS = 16
TURNS_RAD_S = (-2.0, -1.2, -0.6, -0.2, 0.0, 0.2, 0.6, 1.2, 2.0)


def twists() -> Array:
    """Return twists along odom's axes, each constant (STEPS, 3, n)."""
    headings = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False)
    rows = [
        (speed * np.cos(heading), speed * np.sin(heading), turn)
        for speed, heading, turn in product(SPEEDS_M_S, headings, TURNS_RAD_S)
    ]
    return np.tile(np.array(rows, np.float32).T, (STEPS, 1, 1))


class WindowPlanner(Planner):
    """Our planner with constant twists in the samples' place."""

    commands = twists()

    def search(self, nominal: Array, situation: Situation) -> tuple[Rollout, Array]:
        """Return all paths and their costs, independent of the nominal paths."""
        del nominal
        paths = self.roll(self.commands)
        return paths, self.costs.evaluate(paths, situation)


class SamplerFollower(FollowerNode):
    """Our follower, whose planner samples constant velocities."""

    def reset(self, seed: int) -> None:
        """Begin a run."""
        super().reset(seed)
        sheet = data_sheet(self.scenario)
        self.following.planner = make_planner(self.scenario, sheet, seed, WindowPlanner)
