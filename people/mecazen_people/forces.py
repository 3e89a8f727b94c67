"""The social force: how people steer clear of each other, of robots and of obstacles.

D. Helbing & P. Molnár, Social force model for pedestrian dynamics, Phys. Rev. E 51:4282, 1995,
with their parameters: a drive towards the preferred velocity, a repulsion by others with elliptic
potentials ahead of them, a repulsion by obstacles, and fluctuations. The bodies of that model are
points. A second repulsion acts over the gap between bodies, so that they do not touch: D. Helbing,
I. Farkas & T. Vicsek, Simulating dynamical features of escape panic, Nature 407:487, 2000.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from mecazen.config.world import Box, Cylinder
from mecazen.portable import Floats, exp

RELAXATION_S = 0.5
"""Helbing & Molnár's τ; the next five values are also theirs."""
POTENTIAL_M2_S2, POTENTIAL_M = 2.1, 0.3
STRIDE_S = 2.0
"""Time over which a person's ellipse extends ahead [s]."""
OBSTACLE_M2_S2, OBSTACLE_M = 10.0, 0.2
COS_VIEW, BEHIND = math.cos(math.radians(100.0)), 0.5
"""Cosine of half the field of view, and the weight of forces from behind."""
REACH_M = 3.0
"""Distance beyond which obstacles do not count: their force is below 2e-5 m/s² there."""
FASTEST = 1.3
"""Maximum speed, as a multiple of the preferred speed."""
CONTACT_M_S2, CONTACT_M = 25.0, 0.08
"""Helbing, Farkas & Vicsek's A/m and B."""
FLUCTUATION_M_S2 = 0.1
"""Standard deviation of fluctuations, which Helbing & Molnár do not give. People who meet head on
need some to pass each other."""
STRONGEST_M_S2 = 8.0
"""Maximum acceleration of a person."""
LEAST_M = 0.05
"""Least size of an ellipse at which its potential is used: the gradient grows without bounds."""


def repulsion(
    places: Floats, heading: Floats, neighbours: Floats, velocities: Floats, touching: Floats
) -> Floats:
    """Return the acceleration of each of n people by each of m others (n, m, 2) [m/s²].

    People at `places` (n, 2) [m] want to go along the unit vectors `heading` (n, 2), or zeros. The
    others are at `neighbours` (m, 2) [m] and have `velocities` (m, 2) [m/s]. Bodies touch when
    their centres are by `touching` (n, m) [m] apart; there is no force where it is infinite, such
    as from the person themselves.
    """
    apart = places[:, None] - neighbours
    distance = np.maximum(_length(apart), 1e-9)
    away = apart / distance[..., None]
    step = velocities * STRIDE_S
    ahead = apart - step
    ahead_m = np.maximum(_length(ahead), 1e-9)
    total = distance + ahead_m
    b = np.maximum(0.5 * np.sqrt(np.maximum(total**2 - _length(step) ** 2, 0.0)), LEAST_M)
    size = POTENTIAL_M2_S2 / POTENTIAL_M * exp(-b / POTENTIAL_M) * total / (4.0 * b)
    force = size[..., None] * (away + ahead / ahead_m[..., None])
    seen = np.einsum("ik,ijk->ij", heading, force) <= -COS_VIEW * _length(force)
    force *= np.where(seen, 1.0, BEHIND)[..., None]
    gap = np.maximum(distance - touching, 0.0)
    force += (CONTACT_M_S2 * exp(-gap / CONTACT_M))[..., None] * away
    forces: Floats = np.where(np.isfinite(touching)[..., None], force, 0.0)
    return forces


def shapes_of(obstacles: Sequence[Box | Cylinder]) -> Floats:
    """Return obstacles as rectangles with a rim (k, 7).

    Each row is the centre, cosine and sine of the heading, half the length and width, and the rim.
    """
    rows = []
    for thing in obstacles:
        if isinstance(thing, Box):
            yaw, (length, width, _) = math.radians(thing.yaw_deg), thing.size_m
            shape = math.cos(yaw), math.sin(yaw), length / 2, width / 2, 0.0
        else:
            shape = 1.0, 0.0, 0.0, 0.0, thing.size_m[0]
        rows.append((*thing.position_m, *shape))
    return np.array(rows).reshape(-1, 7)


def from_obstacles(places: Floats, shapes: Floats) -> Floats:
    """Return accelerations (n, 2) away from the nearest point of each obstacle [m/s²].

    Obstacles farther than `REACH_M` do not count.
    """
    reach = REACH_M + _length(shapes[:, 4:6]) + shapes[:, 6]
    who, what = (_length(places[:, None] - shapes[:, :2]) < reach).nonzero()
    away, distance = nearest(places[who], shapes[what])
    size = OBSTACLE_M2_S2 / OBSTACLE_M * exp(-np.maximum(distance, 0.0) / OBSTACLE_M)
    force = np.zeros_like(places)
    np.add.at(force, who, size[:, None] * away)
    return force


def nearest(places: Floats, shapes: Floats) -> tuple[Floats, Floats]:
    """Return unit vectors (n, 2) away from an obstacle each, and distances (n,) [m].

    Distances inside are negative. A single place (1, 2) or shape (1, 7) is that of all.
    """
    x, y = (places - shapes[:, :2]).T
    cos, sin = shapes[:, 2], shapes[:, 3]
    local = np.column_stack((cos * x + sin * y, cos * y - sin * x))
    over = np.abs(local) - shapes[:, 4:6]
    outside = np.maximum(over, 0.0)
    distance = _length(outside)
    inside = distance == 0.0
    # inside, the way out leads through the nearest face
    face = np.where(over == over.max(axis=1, keepdims=True), 1.0, 0.0)
    outward = np.sign(local) * np.where(inside[:, None], face, outside)
    outward /= np.maximum(_length(outward), 1e-9)[:, None]
    ahead, aside = outward.T
    turned = np.column_stack((cos * ahead - sin * aside, sin * ahead + cos * aside))
    return turned, np.where(inside, over.max(axis=1), distance) - shapes[:, 6]


def limited(vectors: Floats, longest: Floats | float) -> Floats:
    """Return vectors (n, 2), none longer than `longest`."""
    length = np.maximum(_length(vectors), 1e-9)
    shorter: Floats = vectors * np.minimum(1.0, longest / length)[:, None]
    return shorter


def _length(vectors: Floats) -> Floats:
    length: Floats = np.sqrt(vectors[..., 0] ** 2 + vectors[..., 1] ** 2)
    return length
