"""Tracks of people from the legs in successive scans: a line fitted to the last positions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

SCANS = 5
"""Number of positions for the velocity: half a stride at 10 scans per second."""
LEAST_SCANS = 3
"""With fewer positions, the velocity is assumed to be 0."""
LOOKED_S = 1.0
"""Time for which a cluster counts as a person after it looked like a leg [s]."""
GATE_M = 0.5
"""Maximum distance of a detection from the predicted position [m]."""
FORGET_S = 0.5
"""Time without a detection after which a track ends [s]."""
STILL_M_S = 0.3
"""Slower tracks count as standing [m/s], since the middle of the visible points of a standing
object also moves while the robot drives around it."""


class Track(NamedTuple):
    """The positions of a person in the last scans, in odom."""

    places: tuple[tuple[float, float, float], ...]
    """Time [s], x and y [m] of each position, oldest first."""
    looked: float
    """Time at which the cluster last looked like a leg [s]."""
    direction: tuple[float, float] = (0.0, 0.0)
    """Unit vector of the velocity; zeros while the person stands."""
    speed: float = 0.0
    """Speed [m/s]."""
    newest: float = 0.0
    """Speed along `direction` between the last two positions [m/s]."""

    @classmethod
    def of(cls, places: tuple[tuple[float, float, float], ...], looked: float) -> Track:
        """Return the track through positions, by least squares.

        Only a person's track has a velocity: the visible part of a box also moves as the robot
        drives around it.
        """
        still = cls(places, looked)
        if len(places) < LEAST_SCANS or not still.is_person:
            return still
        times, xs, ys = zip(*places, strict=True)
        middle = math.fsum(times) / len(times)
        offsets = [time - middle for time in times]
        spread = math.fsum(off * off for off in offsets)
        u, v = (
            math.fsum(off * at for off, at in zip(offsets, along, strict=True)) / spread
            for along in (xs, ys)
        )
        speed = math.hypot(u, v)
        if speed < STILL_M_S:
            return still
        u, v = u / speed, v / speed
        (before, x0, y0), (now, x1, y1) = places[-2:]
        newest = ((x1 - x0) * u + (y1 - y0) * v) / (now - before)
        return cls(places, looked, (u, v), speed, newest)

    @property
    def time(self) -> float:
        """Time of the last detection [s]."""
        return self.places[-1][0]

    @property
    def is_person(self) -> bool:
        """Whether the cluster looked like a leg within `LOOKED_S`."""
        return self.time - self.looked <= LOOKED_S

    def at(self, time: float) -> tuple[float, float]:
        """Return the place at a time [s], at constant velocity."""
        seen, x, y = self.places[-1]
        way = (time - seen) * self.speed
        return x + way * self.direction[0], y + way * self.direction[1]


class Tracks:
    """The tracks of everything that may be a person."""

    def __init__(self) -> None:
        self.known: list[Track] = []
        """All tracks, including those that are not visible at the moment."""

    def update(self, time: float, seen: Iterable[tuple[tuple[float, float], bool]]) -> list[Track]:
        """Return the track of each position, continued from the nearest track within `GATE_M`.

        Two positions may continue one track: after a pair of legs separates, both have the velocity
        of the person.

        Args:
            time: Time of the scan [s].
            seen: Positions of clusters in odom [m], each with whether the cluster looks like a leg.
        """
        new, continued = [], set()
        for place, is_leg in seen:
            near = [(math.dist(one.at(time), place), n) for n, one in enumerate(self.known)]
            distance, n = min(near, default=(math.inf, 0))
            last = Track((), -math.inf)
            if distance < GATE_M:
                last = self.known[n]
                continued.add(n)
            places = (*last.places[1 - SCANS :], (time, *place))
            new.append(Track.of(places, time if is_leg else last.looked))
        unseen = [one for n, one in enumerate(self.known) if n not in continued]
        self.known = new + [one for one in unseen if time - one.time <= FORGET_S]
        return new
