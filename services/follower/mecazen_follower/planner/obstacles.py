"""The robot's surroundings: from scans to standing points and walking people."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from mecazen.geometry import Pose2D
from mecazen.messages import LaserScan
from mecazen.portable import Floats, arctan2
from mecazen.scan import BOTH_LEGS_M, Clusters, ranges_of
from mecazen.walkers import Walkers

from mecazen_follower.perception.legs import clusters_of, persons

VOXEL_M = 0.1
"""One point is kept per square of this width [m]."""
MOST_POINTS = 60
"""Maximum number of points; the nearest are kept."""
MEMORY_S = 1.5
"""Time for which a hidden point is remembered [s]."""
BEHIND_M = 0.15
"""A point is hidden by anything that is nearer by at least this distance [m]."""
HALF_STRIDE_M = 0.5
"""Maximum distance of a leg from its person [m]."""
CONFIRMED = 5
"""Minimum number of detections of a walker; fewer may be an edge that comes into view."""
SLOWEST_M_S, FASTEST_M_S = 0.3, 2.5
"""Slower tracks are standing; faster tracks are not persons [m/s]."""


class Surroundings:
    """Everything that the lidar sees except the followed person, in odom."""

    def __init__(self) -> None:
        self._walkers = Walkers()
        self._points: Floats = np.empty((0, 2))
        self._times: Floats = np.empty(0)

    def see(self, time: float, scan: LaserScan, lidar: Pose2D, person: Pose2D) -> None:
        """Update with a scan that was captured at `time` [s] with the lidar at a pose in odom."""
        clusters = clusters_of(scan)
        persons_in_odom = [lidar.compose(pose) for pose, _ in persons(clusters)]
        others = [
            (pose.x, pose.y) for pose in persons_in_odom if pose.distance(person) > HALF_STRIDE_M
        ]
        self._walkers.update(time, others)
        walkers = np.vstack((self.walkers(np.array([time]))[0], [person[:2]]))

        hidden = self._hidden(scan, lidar) & (self._times > time - MEMORY_S)
        clusters = clusters.moved(lidar)
        standing = clusters.xy[~_are_legs(clusters, walkers)]
        self._points = np.vstack((self._points[hidden], standing))
        self._times = np.concatenate((self._times[hidden], np.full(len(standing), time)))

    def walkers(self, times: Floats) -> Floats:
        """Return the predicted positions of walking people (times, n, 2) in odom."""
        walking = [
            (track.x, track.y, track.vx, track.vy, track.time)
            for track in self._walkers.tracks
            if track.detections >= CONFIRMED and SLOWEST_M_S <= track.speed <= FASTEST_M_S
        ]
        state = np.array(walking).reshape(-1, 5)
        ahead: Floats = state[:, :2] + (times[:, None, None] - state[:, 4:]) * state[:, 2:4]
        return ahead

    def standing(self, robot: Pose2D) -> Floats:
        """Return the points that stand still (n, 2) in odom: the nearest, thinned out."""
        offsets = self._points - robot[:2]
        order = np.argsort(np.einsum("ij,ij->i", offsets, offsets), kind="stable")
        near = self._points[order]
        voxels = np.floor(near / VOXEL_M).astype(np.int64)
        _, first = np.unique(voxels[:, 0] * (1 << 32) + voxels[:, 1], return_index=True)
        kept: Floats = near[np.sort(first)[:MOST_POINTS]]
        return kept

    def _hidden(self, scan: LaserScan, lidar: Pose2D) -> npt.NDArray[np.bool_]:
        """Return which known points are hidden in this scan; only these are remembered."""
        offsets = self._points - lidar[:2]
        away = np.hypot(offsets[:, 0], offsets[:, 1])
        angles = arctan2(offsets[:, 1], offsets[:, 0]) - lidar.yaw - scan.angle_min
        ranges = ranges_of(scan)
        if not len(ranges) or not scan.angle_increment:
            return np.ones(len(away), bool)
        turn = abs(math.tau / scan.angle_increment)
        beams = np.round((angles / scan.angle_increment) % turn).astype(int) % round(turn)
        seen = ranges[np.minimum(beams, len(ranges) - 1)]
        hidden: npt.NDArray[np.bool_] = ~(seen >= away - BEHIND_M) | (beams >= len(ranges))
        return hidden


def _are_legs(clusters: Clusters, walkers: Floats) -> npt.NDArray[np.bool_]:
    """Return which points are legs: in clusters no wider than two legs, beside a walking person."""
    off = clusters.middle[:, None] - walkers
    beside = np.hypot(off[..., 0], off[..., 1]).min(axis=1) <= HALF_STRIDE_M
    are_legs: npt.NDArray[np.bool_] = ((clusters.width <= BOTH_LEGS_M) & beside)[clusters.index]
    return are_legs
