"""A follower that also publishes the ways between which its planner has chosen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mecazen.keys import Topic
from mecazen.messages import Float, Message
from mecazen.node import Inputs, Outputs, Tick
from mecazen_follower.node import FollowerNode
from mecazen_follower.planner.mppi import Problem
from mecazen_follower.planner.rollout import Rollout

PROGRAM = f"{Path(__file__)}:PlanningFollower"


class Ways(Message):
    """Ways as points from the robot, along odom's axes, one way after the other."""

    ROS_TYPE = "mecazen_pictures/msg/Ways"
    x: tuple[Float, ...] = ()
    y: tuple[Float, ...] = ()
    count: int = 0
    """Number of ways."""
    chosen: int = 0
    """Index of the way that the robot drives."""


WAYS = Topic("follower/ways", Ways, "ways between which the planner has chosen")


class PlanningFollower(FollowerNode):
    """The follower with its planner."""

    ROW = replace(FollowerNode.ROW, outputs=(*FollowerNode.ROW.outputs, WAYS))

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
        """Return the outputs of the follower, and ways in ticks that bring some."""
        outputs = super().step(tick, inputs)
        new, self._new = self._new, None
        return outputs if new is None else {WAYS: new, **outputs}
