"""Tracks of people, from where legs are scan by scan: a straight line through the last places."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

SCANS = 5
"""Places that give a velocity: half a stride at 10 scans a second."""
LEAST_SCANS = 3
"""With fewer places, the velocity is taken to be 0."""
LOOKED_S = 1.0
"""Time for which something is a person after it has looked like a leg."""
GATE_M = 0.5
"""Greatest distance from where a person is expected."""
FORGET_S = 0.5
"""Time unseen after which a track ends."""
STILL_M_S = 0.3
"""Slower tracks count as standing, since the middle of the visible points of a standing thing also
moves while the robot drives around it."""


class Track(NamedTuple):
    """The places of a person in the last scans, in odom."""

    places: tuple[tuple[float, float, float], ...]
    """Time [s], x and y [m]; the newest is the last one."""
    looked: float
    """When it last looked like a leg [s]."""
    direction: tuple[float, float] = (0.0, 0.0)
    """Unit vector of the velocity; zeros while the person stands."""
    speed: float = 0.0
    """[m/s]"""
    newest: float = 0.0
    """Speed along the direction between the last two places [m/s]."""

    @classmethod
    def of(cls, places: tuple[tuple[float, float, float], ...], looked: float) -> Track:
        """Return the track through some places, by least squares.

        Its velocity is 0 unless it is a person's: the visible part of a box also moves as the
        robot drives around it.
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
        """When it was last seen [s]."""
        return self.places[-1][0]

    @property
    def is_person(self) -> bool:
        """Whether it has looked like a leg lately."""
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
        """All tracks, those that are not seen at the moment too."""

    def update(self, time: float, seen: Iterable[tuple[tuple[float, float], bool]]) -> list[Track]:
        """Return the track of each place, continued from the nearest one within `GATE_M`.

        Two places may continue one track: legs that part are both as fast as their person.

        Args:
            time: Time of the scan [s].
            seen: Places of things in odom [m], each with whether it looks like a leg.
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
