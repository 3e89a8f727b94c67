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
        return self._walker.follow(Motion(pose, twist), gap_s).joints


@cache
def _walker(height_m: float) -> Walker:
    """Return the walker whose gait all bodies of a height share: computing a gait takes 0.2 s."""
    return Walker(Body(height_m=height_m))
