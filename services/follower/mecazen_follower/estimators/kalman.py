"""What the Kalman filters here share."""

from __future__ import annotations

from typing import Any

from mecazen.covariance import PlanarCovariance

from mecazen_follower.estimators.base import Array


def kalman(state: Array, covariance: Array, H: Array) -> Any:
    """Return a filter that starts with `state`, a vector, and observes H times it."""
    # here, and not above: every process reads the follower's config, and this takes a second
    from filterpy.kalman import KalmanFilter  # noqa: PLC0415

    kf = KalmanFilter(dim_x=len(state), dim_z=len(H))
    kf.x, kf.P, kf.H = state, covariance, H
    return kf


def nis_of(kf: Any) -> float:
    """Return the normalised innovation squared of the last update."""
    return float(kf.y @ kf.SI @ kf.y)


def as_tuple(matrix: Array) -> PlanarCovariance:
    """Return a 3x3 covariance as plain numbers."""
    x, y, yaw = map(tuple, matrix.tolist())
    return x, y, yaw
