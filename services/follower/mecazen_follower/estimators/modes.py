"""Kalman filters of constant turn rate and velocity, one for each way to move.

x, y, a, v, w in names of numbers are the state's position, heading, speed and turn rate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mecazen_follower.estimators.base import Array
from mecazen_follower.estimators.symmetric import Rows, factors
from mecazen_follower.estimators.turn_rate import (
    YAW,
    State,
    Triangle,
    Walks,
    carry,
    matrix,
    triangle,
)

LEAST = 1e-100
"""Probability that a mode has at least, besides what normalises it."""


class Mode(NamedTuple):
    """A way to move."""

    walks: Walks
    """See `process_noise`."""
    moves: bool = True
    """Whether the speed lasts; else it is 0 but for its random walk."""
    turns: bool = True
    """Whether the turn rate lasts; else it is 0 but for its random walk."""
    lasts: float = 1.0
    """Mean time until another mode takes over [s]; of no matter to a mode that is alone."""


class Gaussian(NamedTuple):
    """A state and its covariance, as `turn_rate` has them."""

    state: State
    covariance: Triangle


class Together(NamedTuple):
    """All modes as one, with the random walks that have their mean variances."""

    state: State
    covariance: Triangle
    walks: Walks


class ModeBank:
    """Extended Kalman filters, one for each mode, that interact.

    Blom, Bar-Shalom: The interacting multiple model algorithm for systems with Markovian
    switching coefficients, IEEE Trans. Automatic Control 33 (1988). With a single mode it is
    an extended Kalman filter.

    Args:
        modes: The modes; each changes to any other with the same probability.
        state: The first state (5), of all modes.
        covariance: Its covariance (5, 5).
    """

    def __init__(self, modes: tuple[Mode, ...], state: Array, covariance: Array) -> None:
        n = len(modes)
        self._modes = modes
        self._rates = [1.0 / mode.lasts / (n - 1) if n > 1 else 0.0 for mode in modes]
        """Of changes to each of the others [1/s]."""
        self.probabilities = [1.0 / n] * n
        self._filters = [Gaussian(tuple(state.tolist()), triangle(covariance))] * n
        self._made: Together | None = None
        self.nis = 0.0

    @property
    def heading(self) -> float:
        """The heading of all modes together [rad]; not wrapped."""
        headings = (state[YAW] for state, _ in self._filters)
        return sum(p * yaw for p, yaw in zip(self.probabilities, headings, strict=True))

    @property
    def state(self) -> Array:
        """The state (5) of all modes together."""
        return np.array(self._together().state)

    @property
    def covariance(self) -> Array:
        """Its covariance (5, 5)."""
        return matrix(self._together().covariance)

    def _together(self) -> Together:
        """Return all modes together; made when it is asked for, once."""
        if self._made is None:
            probabilities = self.probabilities
            variances = [
                sum(p * walk * walk for p, walk in zip(probabilities, walks, strict=True))
                for walks in zip(*(mode.walks for mode in self._modes), strict=True)
            ]
            sway, step, heading, speed, rate = map(math.sqrt, variances)
            mean = mixture(probabilities, self._filters)
            self._made = Together(*mean, (sway, step, heading, speed, rate))
        return self._made

    def predict(self, dt: float) -> None:
        """Mix the modes and move each by `dt` [s]."""
        others = len(self._modes) - 1
        # over a step longer than a mode lasts, it is left by no more than there is of it
        most = 1.0 / max(others, 1)
        change = [
            p * min(rate * dt, most)
            for p, rate in zip(self.probabilities, self._rates, strict=True)
        ]
        probabilities, filters = [], []
        for i, mode in enumerate(self._modes):
            joint = change.copy()
            joint[i] = self.probabilities[i] - others * change[i]
            probability = sum(joint)
            mixed = mixture([p / probability for p in joint], self._filters)
            probabilities.append(probability)
            filters.append(Gaussian(*carry(*_held(mode, *mixed), mode.walks, dt)))
        self.probabilities, self._filters = probabilities, filters
        self._made = None

    def update(self, observation: Array, noise: Array) -> None:
        """Take in an observation (3) with its covariance (3, 3).

        Raises:
            ValueError: The covariance is not positive definite.
        """
        seen, R = observation.tolist(), noise.tolist()
        corrections = [correct(*before, seen, R) for before in self._filters]
        self._filters = [correction.after for correction in corrections]
        self._made = None

        prior = self.probabilities
        least = min(correction.squared for correction in corrections)
        self.nis = sum(p * of.squared for p, of in zip(prior, corrections, strict=True))
        # none dies of underflow: after two hopeless observations in a row all might
        weights = [
            max(p * math.exp((least - of.squared) / 2.0) / math.sqrt(of.determinant), LEAST)
            for p, of in zip(prior, corrections, strict=True)
        ]
        total = sum(weights)
        self.probabilities = [weight / total for weight in weights]

    def ahead(self, dt: float) -> tuple[State, Triangle]:
        """Return state and covariance `dt` [s] later, if the modes stay as likely as they are."""
        return carry(*self._together(), dt)


def _held(mode: Mode, state: State, covariance: Triangle) -> Gaussian:
    """Return a state of which a mode that does not move or turn takes the rates to be 0."""
    if mode.moves and mode.turns:
        return Gaussian(state, covariance)
    v, w = float(mode.moves), float(mode.turns)
    x, y, yaw, speed, rate = state
    xx, xy, xa, xv, xw, yy, ya, yv, yw, aa, av, aw, vv, vw, ww = covariance
    return Gaussian(
        (x, y, yaw, v * speed, w * rate),
        (
            *(xx, xy, xa, v * xv, w * xw),
            *(yy, ya, v * yv, w * yw),
            *(aa, v * av, w * aw),
            *(v * vv, v * w * vw, w * ww),
        ),
    )


def mixture(weights: Sequence[float], parts: Sequence[Gaussian]) -> Gaussian:
    """Return mean and covariance of a mixture of Gaussians."""
    x = y = a = v = w = 0.0
    for weight, ((ix, iy, ia, iv, iw), _) in zip(weights, parts, strict=True):
        x += weight * ix
        y += weight * iy
        a += weight * ia
        v += weight * iv
        w += weight * iw
    xx = xy = xa = xv = xw = yy = ya = yv = yw = aa = av = aw = vv = vw = ww = 0.0
    for weight, ((ix, iy, ia, iv, iw), P) in zip(weights, parts, strict=True):
        pxx, pxy, pxa, pxv, pxw, pyy, pya, pyv, pyw, paa, pav, paw, pvv, pvw, pww = P
        dx, dy, da, dv, dw = ix - x, iy - y, ia - a, iv - v, iw - w
        xx += weight * (pxx + dx * dx)
        xy += weight * (pxy + dx * dy)
        xa += weight * (pxa + dx * da)
        xv += weight * (pxv + dx * dv)
        xw += weight * (pxw + dx * dw)
        yy += weight * (pyy + dy * dy)
        ya += weight * (pya + dy * da)
        yv += weight * (pyv + dy * dv)
        yw += weight * (pyw + dy * dw)
        aa += weight * (paa + da * da)
        av += weight * (pav + da * dv)
        aw += weight * (paw + da * dw)
        vv += weight * (pvv + dv * dv)
        vw += weight * (pvw + dv * dw)
        ww += weight * (pww + dw * dw)
    return Gaussian((x, y, a, v, w), (xx, xy, xa, xv, xw, yy, ya, yv, yw, aa, av, aw, vv, vw, ww))


class Correction(NamedTuple):
    """What an observation makes of a state, and how it fits."""

    after: Gaussian
    squared: float
    """The normalised innovation squared."""
    determinant: float
    """Of the covariance of the innovation."""


def correct(state: State, covariance: Triangle, seen: Sequence[float], R: Rows) -> Correction:
    """Return what an observation (3) with the covariance R (3, 3) makes of a state.

    With P the covariance, H what sees the first three of the state, S = H P Hᵀ + R and
    K = P Hᵀ S⁻¹, the covariance becomes P - K H P. Of it the first three columns are
    P Hᵀ - K (S - R) = K R: without a difference, which could come out negative when the
    prediction was hopeless.

    Raises:
        ValueError: S is not positive definite.
    """
    xx, xy, xa, xv, xw, yy, ya, yv, yw, aa, av, aw, vv, vw, ww = covariance
    (rxx, rxy, rxa), (_, ryy, rya), (_, _, raa) = R
    S = factors(
        (
            (xx + rxx, xy + rxy, xa + rxa),
            (xy + rxy, yy + ryy, ya + rya),
            (xa + rxa, ya + rya, aa + raa),
        )
    )
    (sxx, sxy, sxa), (_, syy, sya), (_, _, saa) = S.inverse()
    PH = (xx, xy, xa), (xy, yy, ya), (xa, ya, aa), (xv, yv, av), (xw, yw, aw)
    K = [
        (x * sxx + y * sxy + a * sxa, x * sxy + y * syy + a * sya, x * sxa + y * sya + a * saa)
        for x, y, a in PH
    ]
    ix, iy, ia = innovation = [after - before for after, before in zip(seen, state, strict=False)]
    # K R: the new covariance's columns of x, y and a
    (xx, xy, xa), (yx, yy, ya), (ax, ay, aa), (vx, vy, va), (wx, wy, wa) = [
        (x * rxx + y * rxy + a * rxa, x * rxy + y * ryy + a * rya, x * rxa + y * rya + a * raa)
        for x, y, a in K
    ]
    *_, (kvx, kvy, kva), (kwx, kwy, kwa) = K
    after = Gaussian(
        tuple([at + x * ix + y * iy + a * ia for at, (x, y, a) in zip(state, K, strict=True)]),
        (
            *(xx, (xy + yx) / 2.0, (xa + ax) / 2.0, vx, wx),
            *(yy, (ya + ay) / 2.0, vy, wy),
            *(aa, va, wa),
            vv - kvx * xv - kvy * yv - kva * av,
            vw - kvx * xw - kvy * yw - kva * aw,
            ww - kwx * xw - kwy * yw - kwa * aw,
        ),
    )
    return Correction(after, S.squared(innovation), S.determinant)
