"""Points of a scan, and clusters of them."""

from __future__ import annotations

import math

import numpy as np
from mecazen.portable import Floats

from mecazen_experiments.followbench.sight import ANGLES, RANGE
from mecazen_experiments.followbench.view import View

NOTHING_M = 0.01
"""A beam that ends less than this before the maximum range hit nothing [m]."""
REACH_M, LEAST = 0.5, 3
"""DBSCAN: the distance of neighbours [m], and the minimum number of neighbours of a core point,
including itself."""


def points(view: View) -> Floats:
    """Return the points that beams hit, in the world (n, 2) [m]."""
    hit = view.ranges < RANGE - NOTHING_M
    angles, ranges = ANGLES[hit] + view.robot.yaw, view.ranges[hit]
    x, y = view.robot.x + ranges * np.cos(angles), view.robot.y + ranges * np.sin(angles)
    return np.stack((x, y), axis=1)


def clusters(places: Floats) -> list[Floats]:
    """Return the groups of points (n, 2): DBSCAN, Ester et al., KDD 1996; noise is left out."""
    dx = places[:, :1] - places[:, 0]
    dy = places[:, 1:] - places[:, 1]
    near = dx * dx + dy * dy <= REACH_M**2
    core = near.sum(axis=1) >= LEAST
    label = np.full(len(places), -1)
    groups = 0
    for seed in np.flatnonzero(core).tolist():
        if label[seed] >= 0:
            continue
        front = np.zeros(len(places), bool)
        front[seed] = True
        while front.any():
            label[front] = groups
            front = near[front & core].any(axis=0) & (label < 0)
        groups += 1
    return [places[label == group] for group in range(groups)]


def center(places: Floats) -> tuple[float, float]:
    """Return the center of the smallest rectangle around points (n, 2).

    The rectangle shares a side with the convex hull of the points (Freeman & Shapira, 1975).
    """
    hull = _hull(sorted(set(map(tuple, places.tolist()))))
    best, middle = math.inf, (hull[0][0], hull[0][1])
    for (ax, ay), (bx, by) in zip(hull, hull[1:] + hull[:1], strict=True):
        length = math.hypot(bx - ax, by - ay)
        if length == 0.0:
            continue
        c, s = (bx - ax) / length, (by - ay) / length
        along = [c * x + s * y for x, y in hull]
        across = [c * y - s * x for x, y in hull]
        area = (max(along) - min(along)) * (max(across) - min(across))
        if area < best:
            best = area
            u, v = (max(along) + min(along)) / 2, (max(across) + min(across)) / 2
            middle = c * u - s * v, s * u + c * v
    return middle


def _hull(places: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the convex hull of sorted points: Andrew's monotone chain."""
    if len(places) < 3:
        return places
    halves = []
    for ordered in (places, places[::-1]):
        half: list[tuple[float, float]] = []
        for x, y in ordered:
            while len(half) > 1:
                (ax, ay), (bx, by) = half[-2:]
                if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0.0:
                    break
                half.pop()
            half.append((x, y))
        halves.append(half[:-1])
    return halves[0] + halves[1]
