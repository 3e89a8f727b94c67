"""The recent poses of a body, interpolated in time, and its trail."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt
from mecazen.geometry import Pose2D, wrap

TRAIL_NS = 60 * 10**9
TRAIL_STEP_NS = 200_000_000
"""Time between two points of a trail, which has 300."""
POSES = 256
"""Length of the history of poses: 8 s at 30 Hz."""
JUMP_M = 1.0
"""A larger distance between two points of a trail is a jump and begins a new trail."""


class Track:
    """Planar poses of one body by simulated time."""

    def __init__(self) -> None:
        self._poses: deque[tuple[int, Pose2D]] = deque(maxlen=POSES)
        self._trail: deque[tuple[int, float, float]] = deque()

    def add(self, time_ns: int, pose: Pose2D) -> bool:
        """Add a pose; return whether the trail has a new point."""
        self._poses.append((time_ns, pose))
        if self._trail and time_ns - self._trail[-1][0] < TRAIL_STEP_NS:
            return False
        if self._trail and pose.distance(Pose2D(*self._trail[-1][1:])) > JUMP_M:
            self._trail.clear()
        self._trail.append((time_ns, pose.x, pose.y))
        while time_ns - self._trail[0][0] > TRAIL_NS:
            self._trail.popleft()
        return True

    @property
    def trail(self) -> npt.NDArray[np.float64]:
        """The points (N, 2) [m] of the last 60 s."""
        return np.array([point[1:] for point in self._trail])

    @property
    def newest(self) -> Pose2D | None:
        """The last pose."""
        return self._poses[-1][1] if self._poses else None

    def at(self, time_ns: int) -> Pose2D | None:
        """Return the linearly interpolated pose at a time; None without any pose."""
        later: tuple[int, Pose2D] | None = None
        for sample in reversed(self._poses):
            if sample[0] <= time_ns:
                return sample[1] if later is None else _between(sample, later, time_ns)
            later = sample
        return None if later is None else later[1]


def _between(a: tuple[int, Pose2D], b: tuple[int, Pose2D], time_ns: int) -> Pose2D:
    (begin_ns, start), (end_ns, end) = a, b
    part = (time_ns - begin_ns) / (end_ns - begin_ns)
    return Pose2D(
        start.x + part * (end.x - start.x),
        start.y + part * (end.y - start.y),
        wrap(start.yaw + part * wrap(end.yaw - start.yaw)),
    )
