"""filterpy's Kalman filter, bit-identical on all processors."""

from __future__ import annotations

from filterpy.kalman import KalmanFilter
from mecazen.portable import inverse, product

from mecazen_follower.estimators.base import Array


class PortableFilter(KalmanFilter):  # type: ignore[misc]  # filterpy has no types
    """filterpy's filter with its equations, without BLAS and LAPACK.

    `predict` and `update` set the state x, its covariance P, the innovation y, its covariance S,
    the inverse SI and the gain K.
    """

    x: Array
    P: Array

    def predict(
        self, u: Array | None = None, B: Array | None = None, *, F: Array | None = None, Q: Array
    ) -> None:
        """Propagate by x = F x + B u and P = F P Fᵀ + Q; the default for F is `self.F`."""
        F = self.F if F is None else F
        self.x = product(F, self.x)
        if u is not None and B is not None:
            self.x += product(B, u)
        self.P = product(product(F, self.P), F.T) + Q

    def update(self, z: Array, R: Array) -> None:
        """Correct with an observation z and its covariance R, in Joseph form."""
        H = self.H
        PHT = product(self.P, H.T)
        self.y = z - product(H, self.x)
        self.S = product(H, PHT) + R
        self.SI = inverse(self.S)
        self.K = product(PHT, self.SI)
        self.x = self.x + product(self.K, self.y)
        remaining = self._I - product(self.K, H)
        noise = product(product(self.K, R), self.K.T)
        self.P = product(product(remaining, self.P), remaining.T) + noise
