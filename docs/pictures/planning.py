"""A follower that also publishes the paths from which its planner has chosen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from mecazen.drive import Array
from mecazen.graph import NODES
from mecazen.keys import Topic
from mecazen.messages import Float, Message
from mecazen.node import Inputs, Outputs, Tick
from mecazen_follower.node import FollowerNode, data_sheet, make_planner
from mecazen_follower.planner.costs import Rollout, Situation
from mecazen_follower.planner.mppi import Planner

PROGRAM = f"{Path(__file__)}:PlanningFollower"


class Ways(Message):
    """Paths as points relative to the robot, along odom's axes, one path after the other."""

    ROS_TYPE = "mecazen_pictures/msg/Ways"
    x: tuple[Float, ...] = ()
    y: tuple[Float, ...] = ()
    count: int = 0
    """Number of paths."""
    chosen: int = 0
    """Index of the path that the robot drives."""


WAYS = Topic("follower/ways", Ways, "ways between which the planner has chosen")


class RememberingPlanner(Planner):
    """The planner, which keeps the paths of its last search."""

    paths: Ways | None = None

    def search(self, nominal: Array, situation: Situation) -> tuple[Rollout, Array]:
        """Return the paths and their costs, and keep the paths."""
        paths, costs = super().search(nominal, situation)
        x, y = (tuple(axis.T.ravel().tolist()) for axis in (paths.x, paths.y))
        self.paths = Ways(x, y, len(costs), int(np.argmin(costs)))
        return paths, costs


class PlanningFollower(FollowerNode):
    """The follower with its planner, which publishes the planner's paths."""

    ROW = replace(NODES["follower"], outputs=(*NODES["follower"].outputs, WAYS))

    def reset(self, seed: int) -> None:
        """Begin a run."""
        super().reset(seed)
        sheet = data_sheet(self.scenario)
        self.following.planner = make_planner(self.scenario, sheet, seed, RememberingPlanner)

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the outputs of the follower, and paths in ticks with a new plan."""
        outputs = super().step(tick, inputs)
        planner = self.following.planner
        assert isinstance(planner, RememberingPlanner)
        paths, planner.paths = planner.paths, None
        return outputs if paths is None else {WAYS: paths, **outputs}
