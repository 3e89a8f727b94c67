"""From a lidar scan to persons: detects legs and pairs them."""

from __future__ import annotations

import numpy as np
from mecazen.geometry import Pose2D
from mecazen.messages import LaserScan, PlanarCovariance
from mecazen.scan import BOTH_LEGS_M, LEG_M, Clusters, by_person, clusters, ranges_of
from mecazen.walkers import PAIR_STD_M, SINGLE_STD_M

from mecazen_follower.measurement import NO_HEADING

GAP_M = 0.13
"""Neighbouring points that are farther apart belong to different objects; as in K. O. Arras et al.,
Using boosted features for the detection of people in 2D range data, ICRA 2007."""
LEAST_POINTS, LEAST_M = 3, 0.03
"""Minimum number of points on a leg, and its minimum width [m]."""
DEPTH_M = 0.035
"""Distance from the mean of the points on a shank to its axis [m]."""


def clusters_of(scan: LaserScan) -> Clusters:
    """Return everything that a scan shows, in the lidar's frame."""
    return clusters(scan, ranges_of(scan), GAP_M)


def persons(clusters: Clusters) -> list[tuple[Pose2D, PlanarCovariance]]:
    """Return poses of possible persons in the lidar's frame, and their covariances.

    Everything as wide as a leg is taken for a leg. The tracker identifies the person by motion.
    The heading is unknown: its variance is `NO_HEADING`.
    """
    away = np.sqrt(np.sum(clusters.middle**2, axis=-1))
    centres = (clusters.middle * (1.0 + DEPTH_M / np.maximum(away, DEPTH_M))[:, None]).tolist()
    good = (clusters.counts >= LEAST_POINTS) & (clusters.width >= LEAST_M)
    legs = good & (clusters.width <= LEG_M)
    both = good & (clusters.width > LEG_M) & (clusters.width <= BOTH_LEGS_M)
    detections: list[tuple[Pose2D, PlanarCovariance]] = []
    for members, (x, y) in by_person(centres, legs, both):
        is_single = len(members) == 1 and legs[members[0]]
        variance = (SINGLE_STD_M if is_single else PAIR_STD_M) ** 2
        covariance = (variance, 0.0, 0.0), (0.0, variance, 0.0), (0.0, 0.0, NO_HEADING)
        detections.append((Pose2D(x, y), covariance))
    return detections
