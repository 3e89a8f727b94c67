"""A follower that also publishes the paths from which its planner has chosen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mecazen.graph import NODES
from mecazen.keys import Topic
from mecazen.messages import Float, Message
from mecazen.node import Inputs, Outputs, Tick
from mecazen_follower.node import FollowerNode
from mecazen_follower.planner.mppi import Problem
from mecazen_follower.planner.rollout import Rollout

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


class PlanningFollower(FollowerNode):
    """The follower with its planner, which publishes the planner's paths."""

    ROW = replace(NODES["follower"], outputs=(*NODES["follower"].outputs, WAYS))

    def reset(self, seed: int) -> None:
        """Begin a run."""
        super().reset(seed)
        self._new: Ways | None = None
        planner = self.following.planner
        assert planner is not None
        search = planner.search

        def keep(problem: Problem) -> tuple[Rollout, Any]:
            found, costs = search(problem)
            x, y = (tuple(axis.T.ravel().tolist()) for axis in (found.x, found.y))
            self._new = Ways(x, y, len(costs), int(np.argmin(costs)))
            return found, costs

        planner.search = keep

    def step(self, tick: Tick, inputs: Inputs) -> Outputs:
        """Return the outputs of the follower, and paths in ticks with a new plan."""
        outputs = super().step(tick, inputs)
        new, self._new = self._new, None
        return outputs if new is None else {WAYS: new, **outputs}
