"""The interacting multiple model algorithm over Kalman filters of the state of `turn_rate`.

In variable names, x, y, a, v, w are position, heading, speed and turn rate of the state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import mul
from typing import NamedTuple

import numpy as np

from mecazen_follower.estimators.base import Array
from mecazen_follower.estimators.symmetric import Rows, factors
from mecazen_follower.estimators.turn_rate import (
    YAW,
    State,
    Triangle,
    Walks,
    matrix,
    propagate,
    triangle,
)

MIN_WEIGHT = 1e-100
"""Lower bound of a mode's probability before normalisation."""


class Mode(NamedTuple):
    """A mode of motion."""

    walks: Walks
    """See `process_noise`."""
    moves: bool = True
    """Whether the speed persists; otherwise the speed is 0 plus its random walk."""
    turns: bool = True
    """Whether the turn rate persists; otherwise the turn rate is 0 plus its random walk."""
    mean_sojourn: float = 1.0
    """Mean sojourn time [s]; unused in a bank of one mode."""
    fading: float = 0.0
    """Rate at which the turn rate decays [1/s]."""


class Gaussian(NamedTuple):
    """A state and its covariance, as `turn_rate` defines them."""

    state: State
    covariance: Triangle


class Combined(NamedTuple):
    """The mixture of all modes as one Gaussian, with random walks of their mean variances."""

    state: State
    covariance: Triangle
    walks: Walks
    fading: float
    """Mean of the modes' fading rates [1/s]."""


class ModeBank:
    """An extended Kalman filter for each mode, interacting.

    Blom, Bar-Shalom: The interacting multiple model algorithm for systems with Markovian
    switching coefficients, IEEE Trans. Automatic Control 33 (1988). With a single mode it is
    an extended Kalman filter.

    Args:
        modes: The modes; the transitions from a mode to each other mode are equally probable.
        state: The initial state (5) of all modes.
        covariance: Covariance (5, 5) of `state`.
    """

    def __init__(self, modes: tuple[Mode, ...], state: Array, covariance: Array) -> None:
        n = len(modes)
        self._modes = modes
        self._rates = [1.0 / mode.mean_sojourn / (n - 1) if n > 1 else 0.0 for mode in modes]
        """Transition rates to each of the other modes [1/s]."""
        walks = zip(*(mode.walks for mode in modes), strict=True)
        self._variances = [[walk * walk for walk in of_modes] for of_modes in walks]
        """Variance of each random walk, by mode."""
        self._fading = [mode.fading for mode in modes]
        self.probabilities = [1.0 / n] * n
        self._filters = [Gaussian(tuple(state.tolist()), triangle(covariance))] * n
        self._cached: Combined | None = None
        self.nis = 0.0

    @property
    def heading(self) -> float:
        """The mean heading [rad], not wrapped."""
        headings = (state[YAW] for state, _ in self._filters)
        return math.fsum(p * yaw for p, yaw in zip(self.probabilities, headings, strict=True))

    @property
    def state(self) -> Array:
        """The mean state (5)."""
        return np.array(self._combined().state)

    @property
    def covariance(self) -> Array:
        """The covariance (5, 5) of the mean state."""
        return matrix(self._combined().covariance)

    def _combined(self) -> Combined:
        """Return the mixture of all modes; computed on demand, once."""
        if self._cached is None:
            probabilities = self.probabilities
            sway, step, heading, speed, rate = (
                math.sqrt(math.fsum(map(mul, probabilities, variances)))
                for variances in self._variances
            )
            mean = mixture(probabilities, self._filters)
            fading = math.fsum(map(mul, probabilities, self._fading))
            self._cached = Combined(*mean, (sway, step, heading, speed, rate), fading)
        return self._cached

    def predict(self, dt: float) -> None:
        """Mix the modes and propagate each by `dt` [s]."""
        # after a long step all modes are equally probable
        limit = 1.0 / len(self._modes)
        change = [
            p * min(rate * dt, limit)
            for p, rate in zip(self.probabilities, self._rates, strict=True)
        ]
        # each mode gains the same mixture of all modes and loses its change to each mode
        gained = math.fsum(change)
        joined = mixture([p / gained for p in change], self._filters) if gained > 0.0 else None
        probabilities, filters = [], []
        for mode, own, p, lost in zip(
            self._modes, self._filters, self.probabilities, change, strict=True
        ):
            probability = gained + (p - len(self._modes) * lost)
            mixed = own if joined is None else blend(own, joined, gained / probability)
            probabilities.append(probability)
            state, covariance = _without_rates(mode, *mixed)
            moved = propagate(state, covariance, mode.walks, dt, mode.fading)
            filters.append(Gaussian(*moved))
        self.probabilities, self._filters = probabilities, filters
        self._cached = None

    def update(self, observation: Array, noise: Array) -> None:
        """Correct with an observation (3) and its covariance (3, 3).

        Raises:
            ValueError: The covariance is not positive definite.
        """
        observed, R = observation.tolist(), noise.tolist()
        corrections = [correct(*before, observed, R) for before in self._filters]
        self._filters = [correction.after for correction in corrections]
        self._cached = None

        prior = self.probabilities
        least = min(correction.nis for correction in corrections)
        self.nis = math.fsum(p * of.nis for p, of in zip(prior, corrections, strict=True))
        # the bound prevents underflow: two outliers in a row could zero all modes
        weights = [
            max(p * math.exp((least - of.nis) / 2.0) / math.sqrt(of.determinant), MIN_WEIGHT)
            for p, of in zip(prior, corrections, strict=True)
        ]
        total = math.fsum(weights)
        self.probabilities = [weight / total for weight in weights]

    def ahead(self, dt: float) -> tuple[State, Triangle]:
        """Return state and covariance `dt` [s] later at constant mode probabilities."""
        state, covariance, walks, fading = self._combined()
        return propagate(state, covariance, walks, dt, fading)


def _without_rates(mode: Mode, state: State, covariance: Triangle) -> Gaussian:
    """Return a state in which the speed and turn rate are 0 if the mode assumes so."""
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


def blend(one: Gaussian, other: Gaussian, share: float) -> Gaussian:
    """Return mean and covariance of a mixture of two Gaussians, with the `share` of the other."""
    (x, y, a, v, w), (xx, xy, xa, xv, xw, yy, ya, yv, yw, aa, av, aw, vv, vw, ww) = one
    (ox, oy, oa, ov, ow), P = other
    pxx, pxy, pxa, pxv, pxw, pyy, pya, pyv, pyw, paa, pav, paw, pvv, pvw, pww = P
    dx, dy, da, dv, dw = ox - x, oy - y, oa - a, ov - v, ow - w
    k = 1.0 - share
    kx, ky, ka, kv, kw = k * dx, k * dy, k * da, k * dv, k * dw
    return Gaussian(
        (x + share * dx, y + share * dy, a + share * da, v + share * dv, w + share * dw),
        (
            xx + share * (pxx - xx + kx * dx),
            xy + share * (pxy - xy + kx * dy),
            xa + share * (pxa - xa + kx * da),
            xv + share * (pxv - xv + kx * dv),
            xw + share * (pxw - xw + kx * dw),
            yy + share * (pyy - yy + ky * dy),
            ya + share * (pya - ya + ky * da),
            yv + share * (pyv - yv + ky * dv),
            yw + share * (pyw - yw + ky * dw),
            aa + share * (paa - aa + ka * da),
            av + share * (pav - av + ka * dv),
            aw + share * (paw - aw + ka * dw),
            vv + share * (pvv - vv + kv * dv),
            vw + share * (pvw - vw + kv * dw),
            ww + share * (pww - ww + kw * dw),
        ),
    )


class Correction(NamedTuple):
    """Result of a Kalman correction."""

    after: Gaussian
    nis: float
    """The normalised innovation squared."""
    determinant: float
    """Determinant of the innovation covariance."""


def correct(state: State, covariance: Triangle, observed: Sequence[float], R: Rows) -> Correction:
    """Return the correction of a state by an observation (3) with the covariance R (3, 3).

    With P the covariance, H the observation matrix, S = H P Hᵀ + R and K = P Hᵀ S⁻¹, the
    covariance becomes P - K H P. The first three columns of the new covariance are P Hᵀ - K (S - R)
    = K R. This form has no difference, which rounding could make negative after a poor prediction.

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
    ix, iy, ia = innovation = [
        after - before for after, before in zip(observed, state, strict=False)
    ]
    # K R: the columns x, y and a of the new covariance
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
    return Correction(after, S.quadratic(innovation), S.determinant)
