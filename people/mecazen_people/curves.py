"""Plane curves by arc length: the shapes of paths walked at constant speed.

Each has a `length` [m], inf if it is endless, and maps an arc length to the pose there, with the
heading along the curve, and to the curvature, positive to the left.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence

import numpy as np
import scipy  # its parts are loaded when they are used: most paths need none
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen.portable import arctan2


class Arcs:
    """Straights and circular arcs, tangent to each other, from the origin along x.

    `pieces` are pairs of length [m] and curvature [1/m]; the last may be infinitely long.
    """

    def __init__(self, pieces: Sequence[tuple[float, float]]) -> None:
        self._starts: list[float] = []
        self._pieces: list[tuple[Pose2D, float]] = []
        start, pose = 0.0, Pose2D()
        for length, curvature in pieces:
            self._starts.append(start)
            self._pieces.append((pose, curvature))
            start += length
            if math.isfinite(length):
                pose = pose.integrate(Twist2D(1.0, 0.0, curvature), length)
        self.length = start

    def at(self, s: float) -> tuple[Pose2D, float]:
        """Return pose and curvature [1/m] at the arc length `s` [m]."""
        i = bisect_right(self._starts, s) - 1
        pose, curvature = self._pieces[i]
        return pose.integrate(Twist2D(1.0, 0.0, curvature), s - self._starts[i]), curvature


class Lemniscate:
    """Bernoulli's lemniscate, endless, from its crossing along x.

    At the arc length s its point is r = a·sl(s/a) from the crossing and its curvature is 3·r/a²,
    with Gauss's lemniscate functions sl(z) = sd(√2·z | 1/2)/√2 and cl(z) = cn(√2·z | 1/2).
    `size` = 2a [m] is the distance between the ends of the loops; `side` is 1 if the first loop
    turns left, -1 if right.
    """

    length = math.inf

    def __init__(self, size: float, side: float) -> None:
        self._a = size / 2
        self._side = side
        self._round = 4.0 * scipy.special.ellipk(0.5) * self._a / math.sqrt(2.0)

    def at(self, s: float) -> tuple[Pose2D, float]:
        """Return pose and curvature [1/m] at the arc length `s` [m]."""
        z = math.fmod(s, self._round) / self._a
        sn, cl, dn, _ = map(float, scipy.special.ellipj(math.sqrt(2.0) * z, 0.5))
        sl = sn / dn / math.sqrt(2.0)
        r = self._a * sl
        # the bearing of the point is -atan(cl) in the lemniscate's axes, turned by pi/4
        bearing = math.pi / 4 - math.atan(cl)
        yaw = 3.0 * bearing
        x, y = r * math.cos(bearing), r * math.sin(bearing)
        return Pose2D(x, self._side * y, wrap(self._side * yaw)), self._side * 3.0 * sl / self._a


class SmoothCurve:
    """The natural cubic spline through points [m]: its heading and curvature are continuous.

    Parameterised by the square root of the chord lengths, which keeps the curve near points at
    very different distances (E. T. Y. Lee, Choosing nodes in parametric curve interpolation,
    Computer-Aided Design 21, 1989).
    """

    _PIECES = 50  # between two points

    def __init__(self, points: Sequence[tuple[float, float]]) -> None:
        chords = np.sqrt(np.hypot(*np.diff(np.array(points), axis=0).T))
        if not chords.all():
            i = int(np.argmin(chords))
            raise ConfigError(
                f"points_m: points {i + 1} and {i + 2} are the same, {list(points[i])}"
            )
        knots = np.concatenate(([0.0], np.cumsum(chords)))
        spline = scipy.interpolate.CubicSpline(knots, points, bc_type="natural")
        numbers = np.arange(self._PIECES * len(chords) + 1) / self._PIECES
        parameters = np.interp(numbers, np.arange(len(knots)), knots)
        (dx, dy), (ddx, ddy) = spline(parameters, 1).T, spline(parameters, 2).T
        sharp = dx[1:] * dx[:-1] + dy[1:] * dy[:-1] <= abs(dx[:-1] * dy[1:] - dy[:-1] * dx[1:])
        if sharp.any():  # by more than 45 deg from one piece to the next
            point = round(int(np.argmax(sharp)) / self._PIECES) + 1
            raise ConfigError(
                f"points_m turns back too sharply at point {point}; lead it around in a bend"
            )
        speeds = np.hypot(dx, dy)
        lengths = scipy.integrate.cumulative_simpson(speeds, x=parameters, initial=0.0)
        poses = np.column_stack((spline(parameters), np.unwrap(arctan2(dy, dx))))
        curvatures = (dx * ddy - dy * ddx) / (speeds * speeds * speeds)
        slopes = np.column_stack((dx / speeds, dy / speeds, curvatures))
        self._pose = scipy.interpolate.CubicHermiteSpline(lengths, poses, slopes)
        self.length = float(lengths[-1])

    def at(self, s: float) -> tuple[Pose2D, float]:
        """Return pose and curvature [1/m] at the arc length `s` [m]."""
        x, y, yaw = self._pose(s).tolist()
        return Pose2D(x, y, wrap(yaw)), float(self._pose(s, 1)[2])


Curve = Arcs | Lemniscate | SmoothCurve
