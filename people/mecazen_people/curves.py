"""Plane curves by arc length: the shapes of paths walked at constant speed."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are used: most paths need none
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen.portable import arctan2

PIECES = 50
"""Number of pieces of a smooth curve between two points."""


class Curve(NamedTuple):
    """A curve from the origin along x, or through points."""

    length: float
    """[m]; inf if it is endless."""
    at: Callable[[float], tuple[Pose2D, float]]
    """Return the pose at an arc length [m], with the heading along the curve, and the curvature
    [1/m], positive to the left."""


def arcs(pieces: Sequence[tuple[float, float]]) -> Curve:
    """Return straights and circular arcs, tangent to each other.

    `pieces` are pairs of length [m] and curvature [1/m]; the last may be infinitely long.
    """
    starts, poses, start, pose = [], [], 0.0, Pose2D()
    for length, curvature in pieces:
        starts.append(start)
        poses.append(pose)
        start += length
        if math.isfinite(length):
            pose = pose.integrate(Twist2D(1.0, 0.0, curvature), length)

    def at(s: float) -> tuple[Pose2D, float]:
        i = bisect_right(starts, s) - 1
        _, curvature = pieces[i]
        return poses[i].integrate(Twist2D(1.0, 0.0, curvature), s - starts[i]), curvature

    return Curve(start, at)


def lemniscate(size: float, side: float) -> Curve:
    """Return Bernoulli's lemniscate, endless, from its crossing.

    At the arc length s its point is r = a·sl(s/a) from the crossing and its curvature is 3·r/a²,
    with Gauss's lemniscate functions sl(z) = sd(√2·z | 1/2)/√2 and cl(z) = cn(√2·z | 1/2).
    `size` = 2a [m] is the distance between the ends of the loops; `side` is 1 if the first loop
    turns left, -1 if right.
    """
    a = size / 2
    round_m = 4.0 * scipy.special.ellipk(0.5) * a / math.sqrt(2.0)

    def at(s: float) -> tuple[Pose2D, float]:
        z = math.fmod(s, round_m) / a
        sn, cl, dn, _ = map(float, scipy.special.ellipj(math.sqrt(2.0) * z, 0.5))
        sl = sn / dn / math.sqrt(2.0)
        r = a * sl
        # the bearing of the point is -atan(cl) in the lemniscate's axes, turned by pi/4
        bearing = math.pi / 4 - math.atan(cl)
        yaw = 3.0 * bearing
        x, y = r * math.cos(bearing), r * math.sin(bearing)
        return Pose2D(x, side * y, wrap(side * yaw)), side * 3.0 * sl / a

    return Curve(math.inf, at)


def smooth_curve(points: Sequence[tuple[float, float]]) -> Curve:
    """Return the natural cubic spline through points [m]: heading and curvature are continuous.

    Parameterised by the square root of the chord lengths, which keeps the curve near points at
    very different distances (E. T. Y. Lee, Choosing nodes in parametric curve interpolation,
    Computer-Aided Design 21, 1989).
    """
    chords = np.sqrt(np.hypot(*np.diff(np.array(points), axis=0).T))
    if not chords.all():
        i = int(np.argmin(chords))
        raise ConfigError(f"points_m: points {i + 1} and {i + 2} are the same, {list(points[i])}")
    knots = np.concatenate(([0.0], np.cumsum(chords)))
    spline = scipy.interpolate.CubicSpline(knots, points, bc_type="natural")
    numbers = np.arange(PIECES * len(chords) + 1) / PIECES
    parameters = np.interp(numbers, np.arange(len(knots)), knots)
    (dx, dy), (ddx, ddy) = spline(parameters, 1).T, spline(parameters, 2).T
    sharp = dx[1:] * dx[:-1] + dy[1:] * dy[:-1] <= abs(dx[:-1] * dy[1:] - dy[:-1] * dx[1:])
    if sharp.any():  # by more than 45 deg from one piece to the next
        point = round(int(np.argmax(sharp)) / PIECES) + 1
        raise ConfigError(
            f"points_m turns back too sharply at point {point}; lead it around in a bend"
        )
    speeds = np.hypot(dx, dy)
    lengths = scipy.integrate.cumulative_simpson(speeds, x=parameters, initial=0.0)
    poses = np.column_stack((spline(parameters), np.unwrap(arctan2(dy, dx))))
    curvatures = (dx * ddy - dy * ddx) / (speeds * speeds * speeds)
    slopes = np.column_stack((dx / speeds, dy / speeds, curvatures))
    pose = scipy.interpolate.CubicHermiteSpline(lengths, poses, slopes)

    def at(s: float) -> tuple[Pose2D, float]:
        x, y, yaw = pose(s).tolist()
        return Pose2D(x, y, wrap(yaw)), float(pose(s, 1)[2])

    return Curve(float(lengths[-1]), at)
