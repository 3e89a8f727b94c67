"""Cubic Hermite splines, and rules for their slopes."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import pairwise


class Spline:
    """The cubic Hermite spline of a function of one variable.

    `knots` (n, strictly increasing), `values` (n) and `slopes` (n), n >= 2. The first and the
    last piece extrapolate.
    """

    def __init__(
        self, knots: Sequence[float], values: Sequence[float], slopes: Sequence[float]
    ) -> None:
        self._knots = list(knots)
        self._pieces: list[tuple[float, float, float, float]] = []
        self._integrals = [0.0]
        for i, (h, secant) in enumerate(_secants(knots, values)):
            a, b = slopes[i], slopes[i + 1]
            square, cube = (3 * secant - 2 * a - b) / h, (a + b - 2 * secant) / (h * h)
            self._pieces.append((values[i], a, square, cube))
            # at this point the newest piece extends to the next knot
            self._integrals.append(self.integral(self._knots[i + 1]))

    def at(self, t: float) -> tuple[float, float, float]:
        """Return the value, the first and the second derivative at `t`."""
        i = self._piece(t)
        value, slope, square, cube = self._pieces[i]
        d = t - self._knots[i]
        return (
            value + d * (slope + d * (square + d * cube)),
            slope + d * (2 * square + d * 3 * cube),
            2 * square + d * 6 * cube,
        )

    def integral(self, t: float) -> float:
        """Return the integral from the first knot to `t`."""
        i = self._piece(t)
        value, slope, square, cube = self._pieces[i]
        d = t - self._knots[i]
        area = d * (value + d * (slope / 2 + d * (square / 3 + d * cube / 4)))
        return self._integrals[i] + area

    def _piece(self, t: float) -> int:
        return min(max(bisect_right(self._knots, t) - 1, 0), len(self._pieces) - 1)


def natural_slopes(knots: Sequence[float], values: Sequence[float]) -> list[float]:
    """Return the slopes (n) of the natural spline: continuous second derivative, 0 at the ends.

    The second derivatives c solve, at each inner knot i, the tridiagonal
    h[i-1]·c[i-1] + 2·(h[i-1] + h[i])·c[i] + h[i]·c[i+1] = 6·(secant[i] - secant[i-1]).
    """
    pieces = _secants(knots, values)
    # Thomas's algorithm; the last digits of a BLAS depend on its number of threads
    eliminated = [(0.0, 0.0)]
    for (h0, secant0), (h1, secant1) in pairwise(pieces):
        ratio, rest = eliminated[-1]
        pivot = 2 * (h0 + h1) - h0 * ratio
        eliminated.append((h1 / pivot, (6 * (secant1 - secant0) - h0 * rest) / pivot))
    curvatures = [0.0]
    for ratio, rest in reversed(eliminated):
        curvatures.append(rest - ratio * curvatures[-1])
    curvatures.reverse()
    slopes = [
        secant - h * (2 * c0 + c1) / 6
        for (h, secant), (c0, c1) in zip(pieces, pairwise(curvatures), strict=True)
    ]
    h, secant = pieces[-1]
    return [*slopes, secant + h * curvatures[-2] / 6]


def limited_slopes(
    knots: Sequence[float], *coordinates: Sequence[float]
) -> tuple[list[float], ...]:
    """Return slopes that prevent overshoot: the curve rests between repeated points.

    `coordinates` are the values (n) of each coordinate; the result has the same shape. The slope
    at an inner knot is that of the parabola through it and its neighbours, limited to three times
    the shorter secant; at the ends it is the secant. With one coordinate the curve is monotonic
    where its values are: J. M. Hyman, Accurate monotonicity preserving cubic interpolation, SIAM
    J. Sci. Stat. Comput. 4 (1983). The limit is on the length of the vector, so the curve does
    not depend on the frame.
    """
    pieces = [_secants(knots, values) for values in coordinates]
    slopes = [[piece[0][1]] for piece in pieces]
    for around in zip(*(pairwise(piece) for piece in pieces), strict=True):
        limit = 3 * min(math.hypot(*(sides[k][1] for sides in around)) for k in range(2))
        parabola = [
            (h1 * secant0 + h0 * secant1) / (h0 + h1) for (h0, secant0), (h1, secant1) in around
        ]
        share = min(1.0, limit / (math.hypot(*parabola) or 1.0))
        for values, slope in zip(slopes, parabola, strict=True):
            values.append(share * slope)
    return tuple([*values, piece[-1][1]] for values, piece in zip(slopes, pieces, strict=True))


def simpson(
    knots: Sequence[float], values: Sequence[float], function: Callable[[float], float]
) -> list[float]:
    """Return the integrals (n) of a function from the first of `knots` (n) to each of them.

    Simpson's rule uses the `values` (n) at the knots and the function in the middle between them.
    """
    integrals = [0.0]
    for (t0, v0), (t1, v1) in pairwise(zip(knots, values, strict=True)):
        mean = (v0 + 4.0 * function((t0 + t1) / 2) + v1) / 6.0
        integrals.append(integrals[-1] + mean * (t1 - t0))
    return integrals


def _secants(knots: Sequence[float], values: Sequence[float]) -> list[tuple[float, float]]:
    """Return width and secant of each piece."""
    return [
        (t1 - t0, (v1 - v0) / (t1 - t0))
        for (t0, v0), (t1, v1) in pairwise(zip(knots, values, strict=True))
    ]
