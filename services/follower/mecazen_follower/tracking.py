"""Whether the person is being followed: a state machine over the time since they were seen."""

from __future__ import annotations

from enum import StrEnum


class TrackingState(StrEnum):
    """How well the follower knows where the person is."""

    WAITING = "waiting"
    """Not seen yet; the robot stands."""
    FOLLOWING = "following"
    """Seen."""
    COASTING = "coasting"
    """Not seen at the moment; the robot follows the prediction."""
    LOST = "lost"
    """Not seen for too long; the robot stops."""


class Tracker:
    """Derives the tracking state from the time since the person was last seen.

    `coast_after` [s] is at least the time between two frames of the sensor, so that ticks
    between frames do not count as unseen; `lost_after` [s] is longer.

    Attributes:
        state: The state at the last update.
        unseen: Time since the person was last seen [s]; 0 before that.
    """

    def __init__(self, coast_after: float, lost_after: float) -> None:
        self.state = TrackingState.WAITING
        self.unseen = 0.0
        self._coast_after = coast_after
        self._lost_after = lost_after
        self._last_seen: float | None = None

    def update(self, time: float, seen: bool) -> TrackingState:
        """Return the state at simulated `time` [s]; `seen`: an observation came just now."""
        if seen:
            self._last_seen = time
        if self._last_seen is not None:
            self.unseen = time - self._last_seen
            if self.unseen > self._lost_after:
                self.state = TrackingState.LOST
            elif self.unseen > self._coast_after:
                self.state = TrackingState.COASTING
            else:
                self.state = TrackingState.FOLLOWING
        return self.state
