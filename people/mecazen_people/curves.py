"""Plane curves by arc length: the shapes of paths walked at constant speed.

Each has a `length` [m], inf if it is endless, and maps an arc length to the pose there, with the
heading along the curve, and to the curvature, positive to the left.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise

from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D, Twist2D, wrap

from mecazen_people.spline import Spline, natural_slopes, simpson


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

    In its own axes x = a·cos u/(1 + sin²u), y = x·sin u, where its tangent has the angle
    3·atan(sin u) + pi/2 and the curvature 3·cos u/(a·sqrt(1 + sin²u)). Its arc length is an
    elliptic integral, computed numerically. `size` = 2a [m] is the distance between the ends of
    the loops; `side` is 1 if the first loop turns left, -1 if right.
    """

    length = math.inf
    _PIECES = 400  # per round: the arc length is then exact to 1e-9 of the curve's size

    def __init__(self, size: float, side: float) -> None:
        self._a = size / 2
        self._side = side
        start = -math.pi / 2  # the crossing, towards positive x
        self._parameter, self._round = _by_arc_length(
            lambda u: self._a / math.hypot(1.0, math.sin(u)),
            [start + math.tau * i / self._PIECES for i in range(self._PIECES + 1)],
        )

    def at(self, s: float) -> tuple[Pose2D, float]:
        """Return pose and curvature [1/m] at the arc length `s` [m]."""
        u, _, _ = self._parameter.at(math.fmod(s, self._round))
        sin, cos = math.sin(u), math.cos(u)
        x = self._a * cos / (1.0 + sin * sin)
        left = Pose2D(x, x * sin, 3.0 * math.atan(sin) + math.pi / 2)
        x, y, yaw = Pose2D(yaw=math.pi / 4).compose(left)  # so that it leaves the crossing along x
        curvature = 3.0 * cos / (self._a * math.hypot(1.0, sin))
        return Pose2D(x, self._side * y, wrap(self._side * yaw)), self._side * curvature


class SmoothCurve:
    """The natural cubic spline through points [m]: its heading and curvature are continuous.

    Parameterised by the square root of the chord lengths, which keeps the curve near points at
    very different distances (E. T. Y. Lee, Choosing nodes in parametric curve interpolation,
    Computer-Aided Design 21, 1989).
    """

    _PIECES = 50  # between two points

    def __init__(self, points: Sequence[tuple[float, float]]) -> None:
        steps = [math.sqrt(math.dist(p, q)) for p, q in pairwise(points)]
        if 0.0 in steps:
            i = steps.index(0.0)
            raise ConfigError(
                f"points_m: points {i + 1} and {i + 2} are the same, {list(points[i])}"
            )
        knots = list(accumulate(steps, initial=0.0))
        x, y = ([float(p[i]) for p in points] for i in range(2))
        self._x = Spline(knots, x, natural_slopes(knots, x))
        self._y = Spline(knots, y, natural_slopes(knots, y))
        parameters = [
            start + (end - start) * i / self._PIECES
            for start, end in pairwise(knots)
            for i in range(self._PIECES)
        ]
        parameters.append(knots[-1])
        self._refuse_cusps(parameters)
        self._parameter, self.length = _by_arc_length(self._speed, parameters)

    def _speed(self, u: float) -> float:
        return math.hypot(self._x.at(u)[1], self._y.at(u)[1])

    def _refuse_cusps(self, parameters: Sequence[float]) -> None:
        headings = [math.atan2(self._y.at(u)[1], self._x.at(u)[1]) for u in parameters]
        for i, (h0, h1) in enumerate(pairwise(headings)):
            if abs(wrap(h1 - h0)) > math.pi / 4:
                point = round(i / self._PIECES) + 1
                raise ConfigError(
                    f"points_m turns back too sharply at point {point}; lead it around in a bend"
                )

    def at(self, s: float) -> tuple[Pose2D, float]:
        """Return pose and curvature [1/m] at the arc length `s` [m]."""
        u, _, _ = self._parameter.at(s)
        (x, dx, ddx), (y, dy, ddy) = self._x.at(u), self._y.at(u)
        return Pose2D(x, y, math.atan2(dy, dx)), (dx * ddy - dy * ddx) / math.hypot(dx, dy) ** 3


Curve = Arcs | Lemniscate | SmoothCurve


def _by_arc_length(
    speed: Callable[[float], float], parameters: Sequence[float]
) -> tuple[Spline, float]:
    """Return a curve's parameter as a function of its arc length, and its length.

    `speed` is the derivative of the arc length by the parameter, of which the `parameters` are
    increasing values.
    """
    speeds = [speed(u) for u in parameters]
    lengths = simpson(parameters, speeds, speed)
    return Spline(lengths, parameters, [1.0 / v for v in speeds]), lengths[-1]
