"""Walking people, tracked from one detection to the next.

Each track is a Kalman filter of a constant velocity that does a random walk, with the same variance
along both axes: Y. Bar-Shalom, X. R. Li & T. Kirubarajan, Estimation with Applications to Tracking
and Navigation, 2001, section 6.2.2. With pairs of legs 10 times a second its gains of position and
velocity settle at 0.55 and 0.21 a scan, near those of a line through the last five positions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

PAIR_STD_M, SINGLE_STD_M = 0.07, 0.15
"""Standard deviations of a pair of legs, and of one leg, from the person, due to gait [m]."""
SPEED_STD_M_S = 2.0
"""Standard deviation of the velocity of a person who comes into view [m/s]."""
WALK_M2_S3 = 0.5
"""Spectral density of the acceleration: the velocity's variance grows by it each second [m²/s³]."""
GATE_M = 0.5
"""Maximum distance of a detection from the predicted position [m]."""
STILL_M_S = 0.3
"""Slower tracks count as standing [m/s], since the middle of the visible points of a standing
object also moves while the robot drives around it."""
FORGET_S = 0.5
"""Time without a detection after which a track ends [s]."""
LOOKED_S = 1.0
"""Time for which a track counts as a person after a detection that looked like a leg [s]."""

Place = tuple[float, float]


class WalkerTrack(NamedTuple):
    """A track: x, y [m] and velocity [m/s] in the frame of its detections, at `time` [s]."""

    time: float
    x: float
    y: float
    vx: float = 0.0
    vy: float = 0.0
    variances: tuple[float, float, float] = (PAIR_STD_M**2, 0.0, SPEED_STD_M_S**2)
    """Variance of the position [m²], its covariance with the velocity [m²/s], variance of the
    velocity [m²/s²]."""
    seen: tuple[float, float, float] = (-math.inf, 0.0, 0.0)
    """Time [s] and position [m] of the last detection."""
    step: tuple[float, float] = (0.0, 0.0)
    """Velocity from the last detection but one to the last [m/s]."""
    detections: int = 1
    looked_at: float = -math.inf
    """Time of the last detection that looked like a leg [s]."""

    @classmethod
    def begin(cls, time: float, place: Place, variance: float = PAIR_STD_M**2) -> WalkerTrack:
        """Return the track of a first detection, with its variance [m²]."""
        variances = variance, 0.0, SPEED_STD_M_S**2
        return cls(time, *place, variances=variances, seen=(time, *place))

    @property
    def speed(self) -> float:
        """Speed [m/s]."""
        return math.hypot(self.vx, self.vy)

    @property
    def is_person(self) -> bool:
        """Whether a detection looked like a leg within `LOOKED_S` before the last."""
        return self.seen[0] - self.looked_at <= LOOKED_S

    def at(self, time: float) -> Place:
        """Return the predicted position at a time [s]."""
        dt = time - self.time
        return self.x + self.vx * dt, self.y + self.vy * dt

    def predicted(self, time: float) -> WalkerTrack:
        """Return the track at a later time [s]."""
        dt, (pp, pv, vv) = time - self.time, self.variances
        q = WALK_M2_S3 * dt
        variances = (
            pp + (2.0 * pv + vv * dt) * dt + q * dt * dt / 3.0,
            pv + vv * dt + q * dt / 2.0,
            vv + q,
        )
        x, y = self.at(time)
        return self._replace(time=time, x=x, y=y, variances=variances)

    def corrected(self, place: Place, variance: float = PAIR_STD_M**2) -> WalkerTrack:
        """Return the track corrected by a detection at its time, with its variance [m²]."""
        pp, pv, vv = self.variances
        gain, rate = pp / (pp + variance), pv / (pp + variance)
        dx, dy = place[0] - self.x, place[1] - self.y
        dt = max(self.time - self.seen[0], 1e-3)
        return self._replace(
            x=self.x + gain * dx,
            y=self.y + gain * dy,
            vx=self.vx + rate * dx,
            vy=self.vy + rate * dy,
            variances=(gain * variance, rate * variance, vv - rate * pv),
            seen=(self.time, *place),
            step=((place[0] - self.seen[1]) / dt, (place[1] - self.seen[2]) / dt),
            detections=self.detections + 1,
        )


class Walkers:
    """The tracks of everything that may be a person.

    Attributes:
        tracks: All tracks, including those that are out of sight at the moment.
    """

    def __init__(self) -> None:
        self.tracks: list[WalkerTrack] = []

    def update(
        self, time: float, places: Sequence[Place], legs: Sequence[bool] = ()
    ) -> list[WalkerTrack]:
        """Return the track of each detection, continued from the nearest track within `GATE_M`.

        Two detections may continue one track: when a pair of legs separates, both have the
        person's velocity.

        Args:
            time: Time of the detections [s].
            places: Their positions, in a frame that does not move [m].
            legs: Whether each looks like a leg; empty if that is unknown.
        """
        known = [track.predicted(time) for track in self.tracks]
        current, continued = [], set[int]()
        for number, place in enumerate(places):
            distances = [math.dist((track.x, track.y), place) for track in known]
            distance = min(distances, default=math.inf)
            track = WalkerTrack.begin(time, place)
            if distance <= GATE_M:
                nearest = distances.index(distance)
                continued.add(nearest)
                track = known[nearest].corrected(place)
            if any(legs[number : number + 1]):
                track = track._replace(looked_at=time)
            current.append(track)
        self.tracks = current + [
            track
            for number, track in enumerate(known)
            if number not in continued and time - track.seen[0] <= FORGET_S
        ]
        return current
