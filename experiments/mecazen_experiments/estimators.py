"""Estimators for experiments only, for comparison with those of the follower.

A scenario selects them with `programs.follower = "mecazen_experiments.estimators:Follower"`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mecazen.config.follower import CtrvParams
from mecazen_follower.estimators import Array
from mecazen_follower.estimators.imm import (
    IDENTITY,
    OBSERVED,
    SIZE,
    ExtendedFilter,
    H,
    ImmBank,
    Mode,
    ctrv,
    process_noise,
)
from mecazen_follower.node import FollowerNode


class Unscented(ImmBank):
    """An unscented Kalman filter in place of the extended one; `ahead` is of first order.

    Sigma points by R. van der Merwe: Sigma-Point Kalman Filters for Probabilistic Inference
    in Dynamic State-Space Models (2004).
    """

    def __init__(self, modes: Sequence[Mode], sway: float, x: Array, P: Array) -> None:
        from filterpy import kalman  # noqa: PLC0415  # late, since the import takes a second

        super().__init__(modes, sway, x, P)
        points = kalman.MerweScaledSigmaPoints(SIZE, alpha=0.5, beta=2.0, kappa=0.0)
        self._filter: Any = kalman.UnscentedKalmanFilter(
            SIZE,
            OBSERVED,
            dt=0.0,
            hx=lambda x: x[:OBSERVED],
            fx=lambda x, dt: ctrv(x, dt)[0],
            points=points,
        )
        self._filter.x, self._filter.P = x, P

    def predict(self, dt: float) -> None:
        """Propagate by `dt` [s]."""
        self._filter.Q = process_noise(self._variances[0].tolist(), self._filter.x, dt)
        self._filter.predict(dt=dt)
        self._copy()

    def update(self, z: Array, R: Array) -> None:
        """Correct with an observation (3) and its covariance (3, 3)."""
        kf = self._filter
        kf.compute_process_sigmas(0.0)  # around the current state, even without a prediction before
        prediction = kf.P
        kf.update(z, R=R)
        remaining = IDENTITY - kf.K @ H
        # Joseph form, possible since the observation is linear in the state
        P = remaining @ prediction @ remaining.T + kf.K @ R @ kf.K.T
        kf.P = (P + P.T) / 2.0
        self.nis = float(kf.y @ kf.SI @ kf.y)
        self._copy()

    def _copy(self) -> None:
        self.x, self.P = self._filter.x[None], self._filter.P[None]
        self._combined = None


class UnscentedFilter(ExtendedFilter, name="ukf_ctrv", params=CtrvParams):
    """An unscented Kalman filter of constant turn rate and velocity."""

    def _begin(self, x: Array, P: Array) -> ImmBank:
        return Unscented((self._mode,), self._sway, x, P)


class Follower(FollowerNode):
    """The follower, with the estimators of this file."""
