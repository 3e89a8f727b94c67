"""Whether the person is being followed: a state machine fed with sightings."""

from __future__ import annotations

from enum import StrEnum


class TrackingState(StrEnum):
    """How well the follower knows where the person is."""

    WAITING = "waiting"
    """Never seen yet; the robot stands."""
    FOLLOWING = "following"
    """Seen."""
    COASTING = "coasting"
    """Not seen at the moment; the estimator predicts and the robot goes on."""
    LOST = "lost"
    """Not seen for too long; the robot comes to rest."""


class Tracker:
    """Derives the state from the time since the person was last seen.

    `coast_after` [s] is at least the time between two frames of the sensor, so that ticks
    between frames do not count as unseen; `lost_after` [s] is longer.
    """

    def __init__(self, coast_after: float, lost_after: float) -> None:
        self._coast_after = coast_after
        self._lost_after = lost_after
        self._last_seen: float | None = None

    def update(self, time: float, seen: bool) -> TrackingState:
        """Return the state at simulated `time` [s]; `seen`: an observation came just now."""
        if seen:
            self._last_seen = time
        if self._last_seen is None:
            return TrackingState.WAITING
        unseen = time - self._last_seen
        if unseen > self._lost_after:
            return TrackingState.LOST
        if unseen > self._coast_after:
            return TrackingState.COASTING
        return TrackingState.FOLLOWING

    def reset(self) -> None:
        """Wait for the person again, as at the start."""
        self._last_seen = None
