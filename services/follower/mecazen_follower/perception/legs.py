"""From a lidar's scan to persons: where legs are, and which two belong together."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from mecazen.covariance import PlanarCovariance
from mecazen.geometry import Pose2D
from mecazen.messages import LaserScan

from mecazen_follower.measurement import NO_HEADING

GAP_M = 0.13
"""Neighbouring points that are farther apart belong to different things; as in K. O. Arras et al.,
Using boosted features for the detection of people in 2D range data, ICRA 2007."""
LEAST_POINTS = 3
WIDTHS_M = 0.03, 0.25
"""Least and greatest width of a leg, with what it wears."""
BOTH_LEGS_M = 0.5
"""Greatest width of two legs that stand together."""
STRIDE_M = 0.9
"""Two legs of one person are not farther apart."""
DEPTH_M = 0.035
"""From the mean of the points on a shank to its axis."""
PAIR_STD_M, SINGLE_STD_M = 0.07, 0.15
"""Of the middle of two legs, and of one leg, about the person's place: gait, not noise."""

Floats = npt.NDArray[np.float64]


def persons(scan: LaserScan) -> list[tuple[Pose2D, PlanarCovariance]]:
    """Return where persons may be, in the lidar's frame, and the covariances.

    Whatever is as wide as a leg is taken for one: who of them is the person, their motion tells.
    The heading is unknown: its variance is `NO_HEADING`.
    """
    legs, together = _legs(scan)
    found = [_person(*centre, PAIR_STD_M) for centre in together]
    left = set(range(len(legs)))
    pairs = [(math.dist(legs[i], legs[j]), i, j) for i in range(len(legs)) for j in range(i)]
    for distance, i, j in sorted(pairs):
        if distance <= STRIDE_M and {i, j} <= left:
            left -= {i, j}
            (x, y), (u, v) = legs[i], legs[j]
            found.append(_person((x + u) / 2.0, (y + v) / 2.0, PAIR_STD_M))
    return found + [_person(*legs[i], SINGLE_STD_M) for i in sorted(left)]


def _person(x: float, y: float, std: float) -> tuple[Pose2D, PlanarCovariance]:
    variance = std * std
    return Pose2D(x, y), ((variance, 0.0, 0.0), (0.0, variance, 0.0), (0.0, 0.0, NO_HEADING))


def clusters(scan: LaserScan) -> tuple[Floats, npt.NDArray[np.intp]]:
    """Return what was hit, in the lidar's frame, thing by thing, and where each thing begins."""
    ranges: Floats = np.array(scan.ranges)
    (valid,) = np.nonzero((ranges >= scan.range_min) & (ranges <= scan.range_max))
    angles = scan.angle_min + scan.angle_increment * valid
    points = ranges[valid, None] * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
    if not len(points):
        return points, valid
    steps = np.diff(points, axis=0, append=points[:1])
    (cuts,) = np.nonzero(np.einsum("ij,ij->i", steps, steps) > GAP_M**2)
    if not len(cuts):  # one thing: it begins after the widest gap between its beams
        cuts = np.argmax(np.diff(valid, append=valid[0] + len(ranges)), keepdims=True)
    # the scan is a circle: what begins before the first beam goes on after the last
    points = np.roll(points, -(cuts[0] + 1), axis=0)
    return points, np.concatenate(([0], cuts[1:] - cuts[0]))


def _legs(scan: LaserScan) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Return the centres of single legs, and of two legs that stand together."""
    points, starts = clusters(scan)
    if len(points) < LEAST_POINTS:
        return [], []
    counts = np.diff(starts, append=len(points))
    middles = np.add.reduceat(points, starts) / counts[:, None]
    off = np.sum((points - np.repeat(middles, counts, axis=0)) ** 2, axis=-1)
    widths = 2.0 * np.sqrt(np.maximum.reduceat(off, starts))
    away = np.sqrt(np.sum(middles**2, axis=-1))
    centres = middles * (1.0 + DEPTH_M / np.maximum(away, DEPTH_M))[:, None]
    least, greatest = WIDTHS_M
    good = (counts >= LEAST_POINTS) & (widths >= least)
    single = good & (widths <= greatest)
    double = good & (widths > greatest) & (widths <= BOTH_LEGS_M)
    return (
        [(x, y) for x, y in centres[single].tolist()],
        [(x, y) for x, y in centres[double].tolist()],
    )
