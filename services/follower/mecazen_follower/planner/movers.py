"""Walking people, tracked from leg detections by one alpha-beta filter each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mecazen.portable import Floats

ALPHA, BETA = 0.5, 0.15
"""Gains of position and velocity: legs swing about the person by PAIR_STD_M."""
GATE_M = 0.5
"""A detection farther from the predicted place belongs to another person."""
FORGET_S = 0.5
"""Time unseen after which a track is forgotten [s]."""
SCANS = 5
"""Minimum number of detections; fewer may be an edge that comes into view."""
SLOWEST_M_S, FASTEST_M_S = 0.3, 2.5
"""Slower tracks are standing; faster tracks are not persons [m/s]."""


class Mover(NamedTuple):
    """A track: position [m] and velocity [m/s] in odom, their time [s], number of detections."""

    x: float
    y: float
    vx: float
    vy: float
    time: float
    scans: int = 1

    @property
    def walks(self) -> bool:
        """Whether the track is confirmed as a walking person."""
        return self.scans >= SCANS and SLOWEST_M_S <= math.hypot(self.vx, self.vy) <= FASTEST_M_S

    def at(self, time: float) -> tuple[float, float]:
        """Return the predicted position at a time [s], at constant velocity."""
        return self.x + self.vx * (time - self.time), self.y + self.vy * (time - self.time)

    def seen(self, time: float, x: float, y: float) -> Mover:
        """Return the track, corrected by a detection."""
        px, py = self.at(time)
        gain = BETA / max(time - self.time, 1e-3)
        return Mover(
            px + ALPHA * (x - px),
            py + ALPHA * (y - py),
            self.vx + gain * (x - px),
            self.vy + gain * (y - py),
            time,
            self.scans + 1,
        )


class Movers:
    """Everything as wide as legs, with its velocity."""

    def __init__(self) -> None:
        self.tracks: list[Mover] = []

    def update(self, time: float, places: Sequence[tuple[float, float]]) -> None:
        """Update with the legs' positions at `time` [s]; the nearest pairs are matched."""
        pairs = sorted(
            (math.dist(track.at(time), place), i, j)
            for i, track in enumerate(self.tracks)
            for j, place in enumerate(places)
        )
        tracks, left = dict(enumerate(self.tracks)), dict(enumerate(places))
        known: list[Mover] = []
        for distance, i, j in pairs:
            if distance <= GATE_M and i in tracks and j in left:
                known.append(tracks.pop(i).seen(time, *left.pop(j)))
        unseen = [track for track in tracks.values() if time - track.time <= FORGET_S]
        self.tracks = known + unseen + [Mover(x, y, 0.0, 0.0, time) for x, y in left.values()]

    def places(self, time: float) -> Floats:
        """Return the positions of walking people (n, 2)."""
        places: Floats = self.ahead(np.array([time]))[0]
        return places

    def ahead(self, times: Floats) -> Floats:
        """Return the predicted positions of walking people (times, n, 2)."""
        walking = [track for track in self.tracks if track.walks]
        state = np.array([track[:5] for track in walking]).reshape(-1, 5)
        ahead: Floats = state[:, :2] + (times[:, None, None] - state[:, 4:]) * state[:, 2:4]
        return ahead
