"""Estimators for experiments only, for comparison with those of the follower.

A scenario selects them with `programs.follower = "mecazen_experiments.estimators:Follower"`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, cast

import numpy as np
from mecazen.config.follower import CtrvParams
from mecazen_follower.estimators import Array
from mecazen_follower.estimators.ctrv import TurnRateEstimator, walks_of
from mecazen_follower.estimators.modes import ModeBank
from mecazen_follower.estimators.turn_rate import (
    IDENTITY,
    OBSERVATION,
    SEEN,
    SIZE,
    YAW,
    State,
    Triangle,
    Walks,
    move,
    process_noise,
    propagate,
    triangle,
)
from mecazen_follower.node import FollowerNode


class Unscented:
    """An unscented Kalman filter of the state of `turn_rate`.

    Sigma points by R. van der Merwe: Sigma-Point Kalman Filters for Probabilistic Inference
    in Dynamic State-Space Models (2004).
    """

    def __init__(self, walks: Walks, state: Array, covariance: Array) -> None:
        from filterpy import kalman  # noqa: PLC0415  # late, since the import takes a second

        self._walks = walks
        points = kalman.MerweScaledSigmaPoints(SIZE, alpha=0.5, beta=2.0, kappa=0.0)
        self._filter: Any = kalman.UnscentedKalmanFilter(
            SIZE, SEEN, dt=0.0, hx=lambda x: x[:SEEN], fx=move, points=points
        )
        self._filter.x, self._filter.P = state, covariance
        self.nis = 0.0

    @property
    def heading(self) -> float:
        """The heading [rad], not wrapped."""
        return float(self._filter.x[YAW])

    @property
    def state(self) -> Array:
        """The state (5)."""
        return np.asarray(self._filter.x)

    @property
    def covariance(self) -> Array:
        """The covariance (5, 5) of the state."""
        return np.asarray(self._filter.P)

    def predict(self, dt: float) -> None:
        """Propagate by `dt` [s]."""
        self._filter.Q = process_noise(self._walks, self.state, dt)
        self._filter.predict(dt=dt)

    def update(self, observation: Array, noise: Array) -> None:
        """Correct with an observation (3) and its covariance (3, 3)."""
        kf = self._filter
        kf.compute_process_sigmas(0.0)  # around the current state, even without a prediction before
        prediction = kf.P
        kf.update(observation, R=noise)
        remaining = IDENTITY - kf.K @ OBSERVATION
        # Joseph form, possible since the observation is linear in the state
        P = remaining @ prediction @ remaining.T + kf.K @ noise @ kf.K.T
        kf.P = (P + P.T) / 2.0
        self.nis = float(kf.y @ kf.SI @ kf.y)

    def ahead(self, dt: float) -> tuple[State, Triangle]:
        """Return state and covariance `dt` [s] later, to first order."""
        return propagate(tuple(self.state.tolist()), triangle(self.covariance), self._walks, dt)


class UnscentedFilter(TurnRateEstimator, name="ukf_ctrv", params=CtrvParams):
    """An unscented Kalman filter of constant turn rate and velocity."""

    def __init__(self, params: CtrvParams) -> None:
        super().__init__(params)
        # `Unscented` has all used methods of `ModeBank`
        self._begin = cast(
            "Callable[[Array, Array], ModeBank]", partial(Unscented, walks_of(params))
        )


class Follower(FollowerNode):
    """The follower, with the estimators of this file."""
