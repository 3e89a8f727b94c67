"""Poses by time: where something was at any instant between its known poses."""

from __future__ import annotations

from collections import deque

from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, wrap


class PoseHistory:
    """The newest poses of something that moves, kept for `duration_ns` of simulated time."""

    def __init__(self, duration_ns: int) -> None:
        self._duration_ns = duration_ns
        self._times_ns: deque[int] = deque()
        self._poses: deque[Pose2D] = deque()

    def __len__(self) -> int:
        """Return how many poses are kept."""
        return len(self._poses)

    @property
    def span_ns(self) -> tuple[int, int]:
        """The times of the oldest and the newest of at least one pose [ns]."""
        return self._times_ns[0], self._times_ns[-1]

    def add(self, time_ns: int, pose: Pose2D) -> None:
        """Add a pose that is newer than all others."""
        self._times_ns.append(time_ns)
        self._poses.append(pose)
        while time_ns - self._times_ns[0] > self._duration_ns:
            self._times_ns.popleft()
            self._poses.popleft()

    def at(self, time_ns: int) -> Pose2D:
        """Return the pose at a time, between two poses by linear interpolation.

        The yaw turns the shorter way. A known pose is returned unchanged. If the pose at time 0 is
        not known, time 0 means the newest pose, as in ROS's tf2.

        Raises:
            RefusedError: The time is before the oldest pose or after the newest.
        """
        times = self._times_ns
        if not times or not times[0] <= time_ns <= times[-1]:
            if times and time_ns == 0:
                return self._poses[-1]
            known = f"{times[0] / 1e9:g} to {times[-1] / 1e9:g} s" if times else "no time"
            raise RefusedError(f"no pose is known of {time_ns / 1e9:g} s, only of {known}")
        # most queries are for the newest ticks, and a deque is quick at its ends
        index = len(times) - 1
        while index > 0 and times[index - 1] >= time_ns:
            index -= 1
        after = self._poses[index]
        if times[index] == time_ns:
            return after
        before = self._poses[index - 1]
        share = (time_ns - times[index - 1]) / (times[index] - times[index - 1])
        return Pose2D(
            before.x + share * (after.x - before.x),
            before.y + share * (after.y - before.y),
            wrap(before.yaw + share * wrap(after.yaw - before.yaw)),
        )
