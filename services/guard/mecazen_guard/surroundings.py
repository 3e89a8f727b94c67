"""From a lidar's scans to points that must not be touched, with velocities for those of people."""

from __future__ import annotations

import math

import numpy as np
from mecazen.arrays import between, rotate
from mecazen.config import GuardConfig
from mecazen.config.sensors import LidarConfig
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D, PoseHistory
from mecazen.messages import LaserScan
from mecazen.portable import Floats
from mecazen.scan import (
    BOTH_LEGS_M,
    LEG_M,
    Clusters,
    Flags,
    Indices,
    by_person,
    clusters,
    ranges_of,
)
from mecazen.walkers import STILL_M_S, Place, Walkers, WalkerTrack
from mecazen.wire import NS_PER_S

from mecazen_guard.guard import Points

GAP_M = 0.08
"""Neighbouring points that are farther apart belong to different clusters [m]."""
ROUND = 0.03
"""Minimum spread of a leg's points about its chord, as a share of its width. The spread of half a
circle is 0.11, that of two half circles half as much, and that of a flat face with 1 mm of lidar
noise 0.01."""
LEG_POINTS = 4
"""Minimum number of points for the shape test: a leg that is nearer than 2.5 m has more."""
INVALID_SHARE = 0.5
"""Share of invalid beams above which a scan is refused."""
PERSON_SPEED_M_S = 2.0
"""Highest speed of a walking person [m/s]."""
SPACING_M = 0.03
"""Spacing to which the points of a cluster are thinned out [m]."""
FARTHEST_M = 5.0
"""Points beyond this distance are ignored: even the fastest robot and person need 1 s to meet."""
HIDDEN_BEAMS = 3
"""This number of neighbouring beams without a measurement means an object below the minimum
range."""
WALKING_SCANS = 3
"""Minimum number of detections; with fewer, the velocity is assumed to be 0."""


def _velocities(track: WalkerTrack) -> tuple[Place, Place]:
    """Return the velocity of a track, and its certain lower bound [m/s].

    Only a person's track has a velocity: the visible part of a box also moves as the robot drives
    around it. The last step shows first that a person stops.
    """
    speed = track.speed
    if track.detections < WALKING_SCANS or not track.is_person or speed < STILL_M_S:
        return (0.0, 0.0), (0.0, 0.0)
    u, v = track.vx / speed, track.vy / speed
    last = track.step[0] * u + track.step[1] * v
    least = max(min(speed, last) - STILL_M_S, 0.0)
    most, least = min(speed, PERSON_SPEED_M_S), min(least, PERSON_SPEED_M_S)
    return (most * u, most * v), (least * u, least * v)


class Surroundings:
    """Keeps the points of the newest scan and the tracks of people, in odom.

    The lidar is at `mount` in base_link. The driver of a real one may send 0 for no return.
    """

    def __init__(
        self, config: GuardConfig, lidar: LidarConfig, mount: Pose2D, *, is_real: bool = False
    ) -> None:
        self.config, self._lidar, self._mount = config, lidar, mount
        self._is_real = is_real
        self.forget()

    def forget(self) -> None:
        """Forget all points and tracks."""
        self._walkers = Walkers()
        self._points = Points()
        self.time: float | None = None
        """Time of the newest scan [s]; None if there is none."""

    def update(self, scan: LaserScan, now: float, poses: PoseHistory) -> None:
        """Update with a scan that arrives at `now` [s], after `poses` of base_link in odom.

        Raises:
            RefusedError: The scan is not plausible, or no pose is known at its stamp.
        """
        ranges = self._plausible_ranges(scan, now)
        lidar = poses.at(scan.header.stamp.ns).compose(self._mount)
        self.time = scan.header.stamp.ns / NS_PER_S
        seen = clusters(scan, _with_hidden(scan, ranges), GAP_M, FARTHEST_M).moved(lidar)
        if not len(seen.xy):
            self._walkers.update(self.time, ())
            self._points = Points()
            return
        margins = np.full(len(seen.starts), self.config.margin_m)
        velocity, sure = np.zeros((2, len(seen.starts), 2))
        legs = seen.width <= LEG_M
        round_legs = legs & _are_round(seen)
        both = ~legs & (seen.width <= BOTH_LEGS_M)
        persons = by_person(seen.middle.tolist(), legs, both)
        look_like_legs = [bool(round_legs[members].any()) for members, _ in persons]
        tracks = self._walkers.update(self.time, [place for _, place in persons], look_like_legs)
        for (members, _), track in zip(persons, tracks, strict=True):
            velocity[members], sure[members] = _velocities(track)
            if track.is_person:
                margins[members] = self.config.person_margin_m
        xy, cluster = _thinned(seen)
        moves = velocity[cluster].any(axis=1)  # each such point exists twice, at rest and in motion
        self._points = Points(
            np.concatenate((xy, xy[moves])),
            np.concatenate((sure[cluster], velocity[cluster][moves])),
            np.concatenate((margins[cluster], margins[cluster][moves])),
            np.arange(len(xy) + moves.sum()) < len(xy),
        )

    def _plausible_ranges(self, scan: LaserScan, now: float) -> Floats:
        stamp, beams = scan.header.stamp.ns / NS_PER_S, len(scan.ranges)
        if stamp > now + 1e-9:
            raise RefusedError(f"the stamp of a scan is {stamp - now:.3g} s ahead")
        if self.time is not None and stamp <= self.time:
            raise RefusedError("a scan is not newer than the last")
        if beams < self._lidar.beams:
            raise RefusedError(f"a scan has {beams} beams instead of {self._lidar.beams}")
        if not math.radians(self._lidar.fov_deg) * 0.99 <= beams * scan.angle_increment <= 7.0:
            raise RefusedError("the beams of a scan are not spread over the field of view")
        ranges = ranges_of(scan, is_real=self._is_real)
        invalid = float(np.mean(~(ranges >= scan.range_min)))  # NaN is invalid too
        if invalid > INVALID_SHARE:
            raise RefusedError(f"{invalid:.0%} of the beams are invalid")
        return ranges

    def seen_from(self, robot: Pose2D) -> Points:
        """Return the points in base_link, with base_link at `robot` in odom."""
        points = self._points
        return points._replace(
            xy=between(robot, points.xy), velocity=rotate(points.velocity, -robot.yaw)
        )


def _are_round(clusters: Clusters) -> Flags:
    """Return which clusters are curved like a leg."""
    xy, starts, counts = clusters.xy, clusters.starts, clusters.counts
    first = xy[starts]
    chord = xy[starts + counts - 1] - first
    chord /= np.maximum(np.hypot(*chord.T), 1e-9)[:, None]
    off, along = xy - first[clusters.index], chord[clusters.index]
    off = along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]
    mean, square = (np.add.reduceat(part, starts) / counts for part in (off, off**2))
    are_round: Flags = square - mean**2 >= (ROUND * clusters.width) ** 2
    return (counts >= LEG_POINTS) & are_round


def _thinned(clusters: Clusters) -> tuple[Floats, Indices]:
    """Return the points thinned to `SPACING_M`, and the cluster of each point."""
    along = np.cumsum(np.hypot(*np.diff(clusters.xy, axis=0, prepend=clusters.xy[:1]).T))
    cells = (along - along[clusters.starts][clusters.index]) // SPACING_M
    keep = np.diff(cells, prepend=-1.0) != 0.0
    keep[clusters.starts] = True
    return clusters.xy[keep], clusters.index[keep]


def _with_hidden(scan: LaserScan, ranges: Floats) -> Floats:
    """Return the ranges, the minimum range for beams that an object below it hides."""
    hidden = ~(ranges >= scan.range_min)
    if not hidden.any():
        return ranges
    # many in a row are not dropouts
    runs = np.all([np.roll(hidden, k) for k in range(HIDDEN_BEAMS)], axis=0)
    hidden = np.any([np.roll(runs, -k) for k in range(HIDDEN_BEAMS)], axis=0)
    return np.where(hidden, scan.range_min, ranges)
