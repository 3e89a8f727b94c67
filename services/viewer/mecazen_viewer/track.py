"""The recent poses of a body, interpolated in time, and its trail."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt
from mecazen.geometry import Pose2D, PoseHistory

HISTORY_NS = 8 * 10**9
TRAIL_NS = 60 * 10**9
TRAIL_STEP_NS = 200_000_000
"""Time between two points of a trail, which has up to 300 points [ns]."""
JUMP_M = 1.0
"""A larger distance between two points of a trail is a jump and starts a new trail [m]."""


class PoseSeries:
    """Planar poses of one body by simulated time."""

    def __init__(self) -> None:
        self._poses = PoseHistory(HISTORY_NS)
        self._trail: deque[tuple[int, float, float]] = deque()
        self.newest: Pose2D | None = None
        """The newest pose."""

    def add(self, time_ns: int, pose: Pose2D) -> bool:
        """Add a pose; return whether the trail has a new point."""
        self._poses.add(time_ns, pose)
        self.newest = pose
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

    def at(self, time_ns: int) -> Pose2D | None:
        """Return the pose at a time, or the pose nearest in time; None without any pose."""
        if not len(self._poses):
            return None
        oldest_ns, newest_ns = self._poses.span_ns
        return self._poses.at(min(max(time_ns, oldest_ns), newest_ns))
