"""The robot of Follow-Bench: a unicycle about its rear axle, without inertia."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from mecazen.arrays import between, to_rectangle
from mecazen.geometry import Pose2D, wrap
from mecazen.portable import Floats

from mecazen_experiments.followbench.pedestrians.grid import CELL_M

MAX_V, MAX_W = 2.0, math.pi
"""Maximum speed [m/s] and yaw rate [rad/s], forwards and backwards."""
ACCELERATION_V, ACCELERATION_W = 2.0, math.pi
"""Maximum acceleration away from rest [m/s²], [rad/s²]; a moving robot brakes much harder."""
BRAKING = 50.0
"""Ratio of deceleration to acceleration."""
CENTRE, HALF = 0.25, (0.35, 0.275)
"""Centre of the outline ahead of the axle, and half its length and width [m]: 0.70 x 0.55."""
PERSON_RADIUS = 0.3
"""Radius of the disc of a person [m]."""


class Unicycle(NamedTuple):
    """State: pose of the rear axle in the world, speed v [m/s], yaw rate w [rad/s]."""

    pose: Pose2D
    v: float = 0.0
    w: float = 0.0

    def step(self, v: float, w: float, dt: float, size: tuple[float, float]) -> Unicycle:
        """Return the state after a step of `dt` [s] on a map of `size` (width, height) [m].

        As in Euler's method, the robot moves along the heading before the step. A step that would
        leave the map by a cell stops the robot.
        """
        v = _limit(v, self.v, MAX_V, ACCELERATION_V * dt)
        w = _limit(w, self.w, MAX_W, ACCELERATION_W * dt)
        x = self.pose.x + v * math.cos(self.pose.yaw) * dt
        y = self.pose.y + v * math.sin(self.pose.yaw) * dt
        if not all(-CELL_M < at < length + CELL_M for at, length in zip((x, y), size, strict=True)):
            return Unicycle(self.pose)
        return Unicycle(Pose2D(x, y, wrap(self.pose.yaw + w * dt)), v, w)


def touches(pose: Pose2D, discs: Floats, boxes: Floats) -> bool:
    """Return whether the outline at a pose touches a person or a box.

    Args:
        pose: Pose of the rear axle in the world.
        discs: Centres (n, 2) of people [m].
        boxes: Centre x, y [m], yaw [rad], length and width [m] of each box (n, 5).
    """
    return bool(np.any(gaps(pose, discs) <= 0.0)) or _touches_box(pose, boxes)


def gaps(pose: Pose2D, discs: Floats) -> Floats:
    """Return the distances (n) [m] between the outline at a pose and people at (n, 2)."""
    ahead, beside = between(pose, discs).T
    distances: Floats = to_rectangle(ahead - CENTRE, beside, HALF) - PERSON_RADIUS
    return distances


def _limit(wanted: float, now: float, most: float, gain: float) -> float:
    """Return the value nearest to `wanted` that the limits of a step allow.

    While the robot moves, the value changes by at most `gain` away from zero, and by 50 times that
    towards and beyond zero. From rest any value is allowed at once.
    """
    low = now - (BRAKING if now > 0.0 else 1.0) * gain if now else -most
    high = now + (BRAKING if now < 0.0 else 1.0) * gain if now else most
    return min(max(wanted, low, -most), high, most)


def _touches_box(pose: Pose2D, boxes: Floats) -> bool:
    """Return whether the outline touches a box: no edge separates the two.

    The test is the separating axis theorem for rectangles, S. Gottschalk et al., OBBTree, SIGGRAPH
    1996.
    """
    centre = pose.compose(Pose2D(CENTRE))
    dx, dy = boxes[:, 0] - centre.x, boxes[:, 1] - centre.y
    half_length, half_width = boxes[:, 3] / 2.0, boxes[:, 4] / 2.0
    c, s = np.cos(boxes[:, 2]), np.sin(boxes[:, 2])
    cr, sr = math.cos(pose.yaw), math.sin(pose.yaw)
    along, across = np.abs(c * cr + s * sr), np.abs(s * cr - c * sr)
    overlaps = (
        (np.abs(cr * dx + sr * dy) <= HALF[0] + half_length * along + half_width * across)
        & (np.abs(cr * dy - sr * dx) <= HALF[1] + half_length * across + half_width * along)
        & (np.abs(c * dx + s * dy) <= half_length + HALF[0] * along + HALF[1] * across)
        & (np.abs(c * dy - s * dx) <= half_width + HALF[0] * across + HALF[1] * along)
    )
    return bool(np.any(overlaps))
