"""From a lidar's scans to what must not be touched: points, and how fast those of people move."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from mecazen.config import GuardConfig
from mecazen.config.sensors import LidarConfig
from mecazen.geometry import Pose2D
from mecazen.messages import LaserScan

from mecazen_guard.guard import NONE, Floats, Points

GAP_M = 0.08
"""Neighbouring points that are farther apart belong to different things."""
SMALL_M = 0.5
"""What may be somebody's legs, be they seen as one, is no wider."""
LEG_M = 0.25
"""A leg, or two that touch, is no wider ..."""
ROUND = 0.03
"""... and its points spread about its chord by so much of its width: those of half a circle by
0.11, of two by half of it, of a flat face, seen by a lidar with 1 mm of noise, by 0.01."""
LEG_POINTS = 4
"""Fewer tell nothing: a leg that is nearer than 2.5 m has more."""
PERSON_S = 1.0
"""What has looked like a leg is one for so long."""
STRIDE_M = 0.9
"""Two legs of one person are not farther apart."""
JUMP_M = 0.5
"""Between two scans nobody's middle moves farther than this from where it is expected."""
SCANS = 5
"""So many scans give a velocity: half a stride."""
STILL_M_S = 0.3
"""Who is slower stands: as fast does the middle of what is seen move as the robot goes round."""
SPACING_M = 0.03
"""Points of one thing that are nearer to each other are one."""
FARTHEST_M = 5.0
"""What is farther is nobody's concern: the fastest robots and people meet in no less than 1 s."""
HIDDEN_BEAMS = 3
"""So many neighbouring beams without a measurement are something nearer than the least range."""


class _Track:
    """Somebody's middle in the last scans.

    Args:
        seen: Times [s] and places in odom.
        fastest: Nobody is taken to be faster [m/s].
        looked: When it last looked like a leg [s].
    """

    def __init__(
        self, seen: tuple[tuple[float, float, float], ...], fastest: float, looked: float
    ) -> None:
        self.seen, self.looked = seen, looked
        self.is_person = seen[-1][0] - looked <= PERSON_S
        # what is seen of a box moves as the robot goes round it: that is no velocity
        self.velocity, self.sure = _velocity(seen if self.is_person else (), fastest)
        """By a straight line, and the least that is sure of it [m/s]."""


def _velocity(
    seen: tuple[tuple[float, float, float], ...], fastest: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    none = 0.0, 0.0
    if len(seen) < 3:
        return none, none
    middle = math.fsum(time for time, _, _ in seen) / len(seen)
    spread = math.fsum((time - middle) ** 2 for time, _, _ in seen)
    u = math.fsum((time - middle) * x for time, x, _ in seen) / spread
    v = math.fsum((time - middle) * y for time, _, y in seen) / spread
    speed = math.hypot(u, v)
    if speed < STILL_M_S:
        return none, none
    (before, x0, y0), (now, x1, y1) = seen[-2:]
    u, v = u / speed, v / speed
    newest = ((x1 - x0) * u + (y1 - y0) * v) / (now - before)
    sure = min(max(min(speed, newest) - STILL_M_S, 0.0), fastest)
    speed = min(speed, fastest)
    return (u * speed, v * speed), (u * sure, v * sure)


class Surroundings:
    """Keeps what the last scans have shown, in odom.

    Args:
        config: Margins, and how fast people are.
        lidar: What the data sheet of the lidar promises.
        mount: Of the lidar in base_link.
    """

    def __init__(self, config: GuardConfig, lidar: LidarConfig, mount: Pose2D) -> None:
        self.config, self._lidar, self._mount = config, lidar, mount
        self.forget()

    def forget(self) -> None:
        """Begin anew: nothing is known."""
        self._tracks: list[_Track] = []
        self._points = Points()
        self.time: float | None = None
        """When the newest scan was taken [s]; None: there is none."""

    def implausible(self, scan: LaserScan, now: float) -> str:
        """Return what is wrong with a scan that comes at `now` [s]; "" if nothing is."""
        stamp, beams = scan.header.stamp.ns / 1e9, len(scan.ranges)
        if stamp > now + 1e-9:
            return f"a scan is of {stamp - now:.3g} s ahead"
        if self.time is not None and stamp <= self.time:
            return "a scan is not newer than the last"
        if beams < self._lidar.beams:
            return f"a scan has {beams} beams instead of {self._lidar.beams}"
        if not math.radians(self._lidar.fov_deg) * 0.99 <= beams * scan.angle_increment <= 7.0:
            return "the beams of a scan are not spread over the field of view"
        ranges = np.array(scan.ranges)
        invalid = float(np.mean(~(ranges >= max(scan.range_min, 1e-6))))  # NaN is invalid too
        if invalid > self.config.invalid_share:
            return f"{invalid:.0%} of the beams are invalid"
        return ""

    def update(self, scan: LaserScan, robot: Pose2D) -> None:
        """Take a scan that was taken with base_link at `robot` in odom."""
        self.time = scan.header.stamp.ns / 1e9
        xy, new = _points(scan)
        place = robot.compose(self._mount)
        c, s = math.cos(place.yaw), math.sin(place.yaw)
        xy = _turned(xy, c, s) + place[:2]
        if not len(xy):
            self._tracks, self._points = [], Points()
            return
        things = _Things(xy, np.flatnonzero(new))
        margins = np.full(len(things.width), self.config.margin_m)
        velocity, sure = np.zeros((2, len(margins), 2))
        tracks = []
        small = np.flatnonzero(things.width <= SMALL_M).tolist()
        middles = things.middle.tolist()
        for legs in _persons(small, middles):
            x, y = (math.fsum(middles[i][axis] for i in legs) / len(legs) for axis in (0, 1))
            track = self._followed(x, y, bool(things.is_leg[legs].any()))
            tracks.append(track)
            velocity[legs], sure[legs] = track.velocity, track.sure
            if track.is_person:
                margins[legs] = self.config.person_margin_m
        self._tracks = tracks
        xy, of = things.thinned()
        moves = velocity[of].any(axis=1)  # those points are there twice: they stop, or go on
        self._points = Points(
            np.concatenate((xy, xy[moves])),
            np.concatenate((sure[of], velocity[of][moves])),
            np.concatenate((margins[of], margins[of][moves])),
            np.arange(len(xy) + moves.sum()) < len(xy),
        )

    def _followed(self, x: float, y: float, is_leg: bool) -> _Track:
        """Return the track of somebody who is now at a place, with that place."""
        assert self.time is not None
        best, looked, least = (), -math.inf, JUMP_M
        for track in self._tracks:
            time, u, v = track.seen[-1]
            since = self.time - time
            off = math.hypot(u + since * track.velocity[0] - x, v + since * track.velocity[1] - y)
            if off < least:
                best, looked, least = track.seen, track.looked, off  # type: ignore[assignment]
        seen = (*best[1 - SCANS :], (self.time, x, y))
        return _Track(seen, self.config.person_speed_m_s, self.time if is_leg else looked)

    def seen_from(self, robot: Pose2D) -> Points:
        """Return the points in base_link, where it is at `robot` in odom."""
        points = self._points
        c, s = math.cos(robot.yaw), math.sin(robot.yaw)
        return points._replace(
            xy=_turned(points.xy - robot[:2], c, -s), velocity=_turned(points.velocity, c, -s)
        )


def _turned(xy: Floats, c: float, s: float) -> Floats:
    """Return vectors turned by the angle whose cosine and sine are given, (N, 2)."""
    x, y = xy.T
    return np.array((c * x - s * y, s * x + c * y)).T


class _Things:
    """Points in their order, and what of a thing they show; it begins at each of `starts`."""

    def __init__(self, xy: Floats, starts: npt.NDArray[np.intp]) -> None:
        counts = np.diff(starts, append=len(xy))
        self._xy, self._starts = xy, starts
        self._of = np.repeat(np.arange(len(starts)), counts)
        self.middle: Floats = np.add.reduceat(xy, starts) / counts[:, None]
        self.width: Floats = np.hypot(
            *(np.maximum.reduceat(xy, starts) - np.minimum.reduceat(xy, starts)).T
        )
        first = xy[starts]
        chord = xy[starts + counts - 1] - first
        chord /= np.maximum(np.hypot(*chord.T), 1e-9)[:, None]
        off, along = xy - first[self._of], chord[self._of]
        off = along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]
        mean, square = (np.add.reduceat(part, starts) / counts for part in (off, off**2))
        is_round = square - mean**2 >= (ROUND * self.width) ** 2
        self.is_leg = (counts >= LEG_POINTS) & (self.width <= LEG_M) & is_round

    def thinned(self) -> tuple[Floats, npt.NDArray[np.intp]]:
        """Return points without those too near to the one before, and the thing of each."""
        along = np.cumsum(np.hypot(*np.diff(self._xy, axis=0, prepend=self._xy[:1]).T))
        cells = (along - along[self._starts][self._of]) // SPACING_M
        keep = np.diff(cells, prepend=-1.0) != 0.0
        keep[self._starts] = True
        return self._xy[keep], self._of[keep]


def _points(scan: LaserScan) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return what a scan hits, in the lidar's frame, and where another thing begins.

    The points go round from a place where a thing begins.
    """
    ranges: Floats = np.array(scan.ranges)
    hidden = ranges < scan.range_min
    if hidden.any():  # many in a row are no dropouts
        runs = np.all([np.roll(hidden, k) for k in range(HIDDEN_BEAMS)], axis=0)
        hidden = np.any([np.roll(runs, -k) for k in range(HIDDEN_BEAMS)], axis=0)
        ranges = np.where(hidden, scan.range_min, ranges)
    (hit,) = np.nonzero((ranges >= scan.range_min) & (ranges <= min(scan.range_max, FARTHEST_M)))
    if not len(hit):
        return NONE, np.empty(0, bool)
    angles = scan.angle_min + scan.angle_increment * hit
    xy = ranges[hit, None] * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    steps = xy - np.roll(xy, 1, axis=0)
    new = np.einsum("ij,ij->i", steps, steps) > GAP_M**2
    if not new.any():
        new[0] = True
    first = int(np.argmax(new))
    return np.roll(xy, -first, axis=0), np.roll(new, -first)


def _persons(small: list[int], middles: list[list[float]]) -> list[list[int]]:
    """Return which small things are the legs of one person, each thing once."""
    near = sorted(
        (distance, i, j)
        for i in small
        for j in small
        if j < i and (distance := math.dist(middles[i], middles[j])) <= STRIDE_M
    )
    left, found = set(small), []
    for _, i, j in near:
        if {i, j} <= left:
            left -= {i, j}
            found.append([i, j])
    return found + [[i] for i in sorted(left)]
