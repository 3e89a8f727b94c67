"""From a lidar scan to persons: detects legs and pairs them."""

from __future__ import annotations

import math

import numpy as np
from mecazen.geometry import Pose2D
from mecazen.messages import LaserScan, PlanarCovariance
from mecazen.scan import BOTH_LEGS_M, LEG_M, Things, by_person, clusters, hits

from mecazen_follower.measurement import NO_HEADING

GAP_M = 0.13
"""Neighbouring points that are farther apart belong to different things; as in K. O. Arras et al.,
Using boosted features for the detection of people in 2D range data, ICRA 2007."""
LEAST_POINTS, LEAST_M = 3, 0.03
"""Minimum number of points on a leg, and its minimum width [m]."""
DEPTH_M = 0.035
"""Distance from the mean of the points on a shank to its axis [m]."""
PAIR_STD_M, SINGLE_STD_M = 0.07, 0.15
"""Standard deviations of a pair of legs, and of one leg, from the person, due to gait [m]."""


def things_of(scan: LaserScan) -> Things:
    """Return all things that a scan shows, in the lidar's frame."""
    points, beams = hits(scan, np.array(scan.ranges))
    return Things(*clusters(points, beams, len(scan.ranges), GAP_M))


def persons(things: Things) -> list[tuple[Pose2D, PlanarCovariance]]:
    """Return poses of possible persons in the lidar's frame, and their covariances.

    Everything as wide as a leg is taken for a leg. The tracker identifies the person by motion.
    The heading is unknown: its variance is `NO_HEADING`.
    """
    away = np.sqrt(np.sum(things.middle**2, axis=-1))
    centres = (things.middle * (1.0 + DEPTH_M / np.maximum(away, DEPTH_M))[:, None]).tolist()
    good = (things.counts >= LEAST_POINTS) & (things.width >= LEAST_M)
    legs = good & (things.width <= LEG_M)
    both = good & (things.width > LEG_M) & (things.width <= BOTH_LEGS_M)
    found = []
    for of in by_person(centres, legs, both):
        x, y = (math.fsum(centres[i][axis] for i in of) / len(of) for axis in (0, 1))
        found.append(_person(x, y, SINGLE_STD_M if len(of) == 1 and legs[of[0]] else PAIR_STD_M))
    return found


def _person(x: float, y: float, std: float) -> tuple[Pose2D, PlanarCovariance]:
    variance = std * std
    return Pose2D(x, y), ((variance, 0.0, 0.0), (0.0, variance, 0.0), (0.0, 0.0, NO_HEADING))
