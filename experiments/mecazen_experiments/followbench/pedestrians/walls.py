"""Finds the obstacle that is nearest to a place."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from mecazen.config.world import Box, Cylinder


class Walls:
    """Boxes and cylinders on the ground, each stored as a rectangle with a margin.

    Args:
        obstacles: The obstacles.
    """

    def __init__(self, obstacles: Sequence[Box | Cylinder]) -> None:
        rows = [_rectangle(thing) for thing in obstacles]
        self._rows = np.array(rows).reshape(-1, 7).T

    def nearest(self, x: float, y: float) -> tuple[float, float, float]:
        """Return the unit vector away from the nearest obstacle and its distance [m].

        The distance is negative inside; without obstacles it is infinite.
        """
        if not self._rows.shape[1]:
            return 0.0, 0.0, math.inf
        px, py, c, s, length, width, margin = self._rows
        dx, dy = x - px, y - py
        along, across = c * dx + s * dy, c * dy - s * dx
        over, beside = np.abs(along) - length, np.abs(across) - width
        out_x, out_y = np.maximum(over, 0.0), np.maximum(beside, 0.0)
        outside = np.sqrt(out_x * out_x + out_y * out_y)
        gaps = np.where(outside > 0.0, outside, np.maximum(over, beside)) - margin
        n = int(gaps.argmin())
        way_x, way_y = float(out_x[n]), float(out_y[n])
        if not way_x and not way_y:  # inside: out through the nearest face
            way_x, way_y = (1.0, 0.0) if over[n] >= beside[n] else (0.0, 1.0)
        size = math.sqrt(way_x * way_x + way_y * way_y)
        way_x = math.copysign(way_x / size, float(along[n]))
        way_y = math.copysign(way_y / size, float(across[n]))
        cos, sin = float(c[n]), float(s[n])
        return cos * way_x - sin * way_y, sin * way_x + cos * way_y, float(gaps[n])


def _rectangle(thing: Box | Cylinder) -> tuple[float, float, float, float, float, float, float]:
    """Return x, y, cos and sin of the yaw, half the length and width, and the margin."""
    x, y = thing.position_m
    if isinstance(thing, Cylinder):
        return x, y, 1.0, 0.0, 0.0, 0.0, thing.size_m[0]
    yaw = math.radians(thing.yaw_deg)
    length, width, _ = thing.size_m
    return x, y, math.cos(yaw), math.sin(yaw), length / 2.0, width / 2.0, 0.0
