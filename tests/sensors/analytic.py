"""Rays against shapes in closed form: a second implementation that the scene is checked with.

Every solid here is convex, so a ray has one interval [enter, leave] in it: the slab method for
boxes, and unions or intersections of such intervals for the others. Nothing of it is MuJoCo's,
which tests faces and roots one by one.

All functions take origins and unit directions (n, 3) and return distances (n,) [m], inf where
nothing is hit. From inside, the distance is that to where the ray leaves.
"""

import numpy as np


def first(enter, leave):
    """The first point ahead of an interval: its begin, or its end from inside."""
    hit = (enter <= leave) & (leave >= 0.0)
    return np.where(hit, np.where(enter >= 0.0, enter, leave), np.inf)


def slab(position, speed, half):
    """Where |position + t speed| <= half."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (-half - position) / speed, (half - position) / speed
    enter, leave = np.minimum(one, other), np.maximum(one, other)
    inside = np.abs(position) <= half
    parallel = speed == 0.0
    enter = np.where(parallel, np.where(inside, -np.inf, np.inf), enter)
    return enter, np.where(parallel, np.where(inside, np.inf, -np.inf), leave)


def quadratic(a, b, c):
    """Where a t² + 2 b t + c <= 0."""
    square = b * b - a * c
    root = np.sqrt(np.maximum(square, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        enter, leave = (-b - root) / a, (-b + root) / a
    flat = a == 0.0
    enter = np.where(flat, np.where(c <= 0.0, -np.inf, np.inf), enter)
    leave = np.where(flat, np.where(c <= 0.0, np.inf, -np.inf), leave)
    missed = ~flat & (square < 0.0)
    return np.where(missed, np.inf, enter), np.where(missed, -np.inf, leave)


def ground(origins, directions):
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -origins[:, 2] / directions[:, 2]
    return np.where((directions[:, 2] < 0.0) & (t >= 0.0), t, np.inf)


def box(origins, directions, centre, rotation, half):
    """A box about `centre` whose axes are the columns of `rotation`."""
    positions, speeds = (origins - centre) @ rotation, directions @ rotation
    slabs = [slab(positions[:, i], speeds[:, i], half[i]) for i in range(3)]
    return first(np.max([s[0] for s in slabs], axis=0), np.min([s[1] for s in slabs], axis=0))


def _round(origins, directions, centre, axis, radius):
    offset = origins - centre
    along, speed = offset @ axis, directions @ axis
    offset, across = offset - along[:, None] * axis, directions - speed[:, None] * axis
    a = np.where(np.abs(speed) > 1.0 - 1e-15, 0.0, np.sum(across * across, axis=1))
    interval = quadratic(a, np.sum(offset * across, 1), np.sum(offset**2, 1) - radius**2)
    return interval, along, speed


def cylinder(origins, directions, centre, axis, radius, half):
    """A cylinder about `centre`, `half` long to either side along the unit vector `axis`."""
    (enter, leave), along, speed = _round(origins, directions, centre, axis, radius)
    begin, end = slab(along, speed, half)
    return first(np.maximum(enter, begin), np.minimum(leave, end))


def _sphere(origins, directions, centre, radius):
    offset = origins - centre
    b, c = np.sum(offset * directions, 1), np.sum(offset**2, 1) - radius**2
    return quadratic(np.ones(len(b)), b, c)


def capsule(origins, directions, begin, end, radius):
    """All within `radius` of the segment from `begin` to `end`; of no length, a sphere."""
    length = np.linalg.norm(end - begin)
    parts = [_sphere(origins, directions, centre, radius) for centre in (begin, end)]
    if length > 0.0:
        axis, middle = (end - begin) / length, (begin + end) / 2
        (enter, leave), along, speed = _round(origins, directions, middle, axis, radius)
        first_, last = slab(along, speed, length / 2)
        enter, leave = np.maximum(enter, first_), np.minimum(leave, last)
        missed = enter > leave
        parts.append((np.where(missed, np.inf, enter), np.where(missed, -np.inf, leave)))
    return first(np.min([p[0] for p in parts], axis=0), np.max([p[1] for p in parts], axis=0))
