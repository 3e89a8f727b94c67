"""Shared parts of the Kalman filters."""

from __future__ import annotations

from typing import Any

from mecazen_follower.estimators.base import Array


def kalman(state: Array, covariance: Array, H: Array) -> Any:
    """Return a filter that starts with a state (n) and observes H (m, n) times it."""
    # imported late: it takes a second, and every process reads the follower's configuration
    from filterpy.kalman import KalmanFilter  # noqa: PLC0415

    kf = KalmanFilter(dim_x=len(state), dim_z=len(H))
    kf.x, kf.P, kf.H = state, covariance, H
    return kf


def nis_of(kf: Any) -> float:
    """Return the normalised innovation squared of the last update."""
    return float(kf.y @ kf.SI @ kf.y)
