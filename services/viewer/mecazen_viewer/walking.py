"""The animated body of a person if only the pose is published."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import numpy.typing as npt
from mecazen.config.people import Body
from mecazen.geometry import Pose2D, Twist2D
from mecazen_people.body.walker import Walker
from mecazen_people.motion import Motion

STEP_S = 0.04
"""Longest step of the gait [s]; longer intervals are divided into several steps."""
GAP_S = 1.0
"""Longest gap after which the walk continues; after a longer gap the body starts standing [s]."""


class WalkingBody:
    """A body of `height_m` that walks along the given poses."""

    def __init__(self, height_m: float) -> None:
        self._walker = _walker(height_m).twin()
        self._time_ns = -math.inf

    def walk(self, pose: Pose2D, twist: Twist2D, time_ns: int) -> npt.NDArray[np.float64]:
        """Walk to a pose and return the joints (20, 3) in world [m].

        `twist` is the velocity at the pose in the person's frame, `time_ns` the simulated time.
        """
        gap_s, self._time_ns = (time_ns - self._time_ns) / 1e9, time_ns
        if not 0.0 <= gap_s <= GAP_S:
            return self._walker.reset(Motion(pose)).joints
        steps = max(math.ceil(gap_s / STEP_S), 1)
        for left in reversed(range(steps)):
            on_the_way = pose.integrate(twist, -left * gap_s / steps)
            posture = self._walker.step(Motion(on_the_way, twist), gap_s / steps)
        return posture.joints


@cache
def _walker(height_m: float) -> Walker:
    """Return the walker whose gait all bodies of a height share: computing a gait takes 0.2 s."""
    return Walker(Body(height_m=height_m))
