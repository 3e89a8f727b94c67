"""Kalman filters of constant turn rate and velocity, one for each way to move."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mecazen_follower.estimators.base import Array
from mecazen_follower.estimators.symmetric import Rows, factors
from mecazen_follower.estimators.turn_rate import (
    IDENTITY,
    SEEN,
    SEES,
    SIZE,
    State,
    Walks,
    carry,
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


class Combined(NamedTuple):
    """The mixture of all modes in plain numbers."""

    state: State
    covariance: Rows
    walks: Walks


class ModeBank:
    """Extended Kalman filters, one for each mode, that interact; all n at once.

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
        self._walks = [mode.walks for mode in modes]
        self._variances = np.square(self._walks)
        self._stays = np.eye(n)
        self._keeps = np.ones((n, SIZE))
        self._keeps[:, 3:] = [(mode.moves, mode.turns) for mode in modes]
        self._keeps_both = self._keeps[:, :, None] * self._keeps[:, None]
        leaves = np.array([1.0 / mode.lasts for mode in modes])
        others = np.full((n, n), 1.0 / max(n - 1, 1)) * (1.0 - self._stays)
        self._rates = leaves[:, None] * (others - self._stays) if n > 1 else np.zeros((1, 1))
        self.probabilities = np.full(n, 1.0 / n)
        self._x = np.tile(state, (n, 1))
        self._P = np.tile(covariance, (n, 1, 1))
        self.nis = 0.0
        self._combined: Combined | None = None

    @property
    def state(self) -> Array:
        """The state (5) of the mixture of all modes."""
        return self.probabilities @ self._x

    @property
    def covariance(self) -> Array:
        """Its covariance (5, 5)."""
        return np.array(self._combine().covariance)

    def _combine(self) -> Combined:
        """Return the mixture of all modes; made when it is asked for, once."""
        if self._combined is None:
            x, P = _mixture(self.probabilities, self._x, self._P)
            sway, step, heading, speed, rate = np.sqrt(
                self.probabilities @ self._variances
            ).tolist()
            walks = sway, step, heading, speed, rate
            self._combined = Combined(x.tolist(), P.tolist(), walks)
        return self._combined

    def predict(self, dt: float) -> None:
        """Mix the modes and move each by `dt` [s]."""
        joint = self.probabilities[:, None] * (self._stays + self._rates * dt)
        self.probabilities = joint.sum(axis=0)
        x, P = _mixture((joint / self.probabilities).T, self._x, self._P)

        x *= self._keeps
        P *= self._keeps_both
        modes = zip(x.tolist(), P.tolist(), self._walks, strict=True)
        moved = [carry(*mode, dt) for mode in modes]
        self._x = np.array([state for state, _ in moved])
        self._P = np.array([covariance for _, covariance in moved])
        self._combined = None

    def update(self, observation: Array, noise: Array) -> None:
        """Take in an observation (3) with its covariance (3, 3).

        Raises:
            ValueError: The covariance is not positive definite.
        """
        innovation = observation - self._x[:, :SEEN]
        PH = self._P[:, :, :SEEN]
        S = [factors(rows) for rows in (PH[:, :SEEN] + noise).tolist()]
        K = PH @ np.array([mode.inverse() for mode in S])
        self._x = self._x + (K @ innovation[..., None])[..., 0]
        keeps = IDENTITY - K @ SEES
        # Joseph's form: P - K S K' comes out negative when a prediction was hopeless
        P = keeps @ self._P @ keeps.mT + K @ noise @ K.mT
        self._P = (P + P.mT) / 2.0  # what rounding makes unequal would grow

        prior = self.probabilities.tolist()
        squared = [mode.squared(of) for mode, of in zip(S, innovation.tolist(), strict=True)]
        self.nis = sum(p * square for p, square in zip(prior, squared, strict=True))
        least = min(squared)
        # none dies of underflow: after two hopeless observations in a row all might
        weights = [
            max(p * math.exp((least - square) / 2.0) / math.sqrt(mode.determinant), LEAST)
            for p, square, mode in zip(prior, squared, S, strict=True)
        ]
        total = sum(weights)
        self.probabilities = np.array([weight / total for weight in weights])
        self._combined = None

    def ahead(self, dt: float) -> tuple[State, Rows]:
        """Return state and covariance `dt` [s] later, if the modes stay as likely as they are."""
        return carry(*self._combine(), dt)


def _mixture(weights: Array, x: Array, P: Array) -> tuple[Array, Array]:
    """Return means (..., 5) and covariances (..., 5, 5) of mixtures of n Gaussians.

    Args:
        weights: How much of each there is (..., n).
        x: The means of the Gaussians (n, 5).
        P: Their covariances (n, 5, 5).
    """
    mean = weights @ x
    apart = x - mean[..., None, :]
    within = (weights @ P.reshape(len(P), -1)).reshape(*mean.shape, SIZE)
    return mean, within + apart.mT @ (weights[..., None] * apart)
