"""The paper's Kalman filter."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from mecazen.config.follower import DisplacementParams
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen.portable import inverse

from mecazen_follower.estimators.base import Array, Estimate, Estimator, as_tuple

IDENTITY = np.eye(3)


class DisplacementFilter(Estimator, name="kf_displacement"):
    """Our interpretation of the filter of "A Virtual Mecanum Wheeled Robot ROS Simulator ...".

    The paper's equations are X_k = F X_(k-1) + w (1), y_k = H X_(k-1) + u (2), with the state
    X = [x, y, yaw], and (4)

        F = [[1, 0, Δx], [0, 1, Δy], [0, 0, 1]],  H = [1, 1, 0],

    where Δx, Δy are "the displacement per unit time".

    The equations cannot be taken literally: F X moves the person by yaw times Δ, so a person who
    walks at yaw = 0 would stand still; and H X = x + y is a single number, from which x and y are
    not observable.

    Our interpretation: F is the homogeneous matrix of a translation and acts on (x, y, 1), that
    is x += Δx, y += Δy. This is a constant input, so the covariance grows by Q alone. H is the
    diagonal of the matrix that selects the observed components, x and y but not yaw:
    H = [[1, 0, 0], [0, 1, 0]]. y_k observes X_k.

    Δ per second is the displacement between consecutive corrected estimates, exponentially
    smoothed over `smoothing_s`. The filter does not correct the yaw. As the paper defines, the yaw
    is the direction of motion, that of Δ. Below `min_speed_m_s` it is the observed yaw, smoothed
    over `smoothing_s`. The yaw rate is zero (the third row of F).
    """

    def __init__(self, params: DisplacementParams) -> None:
        super().__init__(params)
        self._drift = params.position_drift_m_sqrt_s**2
        self._smoothing = params.smoothing_s
        self._min_speed = params.min_speed_m_s
        self.reset()

    def reset(self) -> None:
        self.nis = None
        self._filter: Any = None
        self._velocity: Array = np.zeros(3)
        self._corrected: Array = np.zeros(3)
        self._elapsed = 0.0

    def predict(self, dt: float) -> None:
        """Propagate the estimate by `dt` [s].

        Displacement and drift are linear in time, so the filter is updated only when an
        observation comes.
        """
        if self._filter is not None:
            self._elapsed += dt

    def _observe(self, observation: Pose2D, noise: Array) -> None:
        if self._filter is None:
            self._filter = _kalman(np.array(observation), noise, np.eye(2, 3))
            self._corrected = np.array(observation)
            return
        kf = self._filter
        drift = self._drift * self._elapsed
        moved = self._velocity * self._elapsed
        kf.predict(u=moved, B=IDENTITY, Q=np.diag([drift, drift, 0.0]))
        kf.update(np.array(observation[:2]), R=noise[:2, :2])
        innovation = kf.y.astype(float)
        self.nis = float(np.einsum("i,ij,j", innovation, kf.SI, innovation))
        if self._elapsed > 0.0:
            weight = -math.expm1(-self._elapsed / self._smoothing)
            displacement = (kf.x - self._corrected) / self._elapsed
            displacement[2] = 0.0
            self._velocity = self._velocity + weight * (displacement - self._velocity)
            kf.x[2] = self._yaw(float(kf.x[2]), observation.yaw, weight)
        kf.P[2, 2] = float(noise[2, 2])  # unfiltered yaw: the variance of one observation
        self._corrected = kf.x.copy()
        self._elapsed = 0.0

    def _yaw(self, yaw: float, observed: float, weight: float) -> float:
        vx, vy = self._velocity[:2]
        if math.hypot(vx, vy) > self._min_speed:
            return math.atan2(vy, vx)
        return wrap(yaw + weight * wrap(observed - yaw))

    @property
    def estimate(self) -> Estimate | None:
        """The current estimate; its velocity is the smoothed displacement per second."""
        if self._filter is None:
            return None
        x, y, yaw = self._filter.x.tolist()
        vx, vy, _ = self._velocity.tolist()
        (xx, xy, xw), (yx, yy, yw), seen = as_tuple(self._filter.P)
        drift, dt = self._drift * self._elapsed, self._elapsed
        return Estimate(
            Pose2D(x + vx * dt, y + vy * dt, yaw),
            Twist2D(vx, vy, 0.0),
            ((xx + drift, xy, xw), (yx, yy + drift, yw), seen),
        )


def _kalman(state: Array, covariance: Array, H: Array) -> Any:
    """Return filterpy's filter, which starts with a state (n) and observes H (m, n) times it.

    Its arrays hold Python's floats: NumPy multiplies such arrays without BLAS, whose results depend
    on the processor.
    """
    # imported late: the import takes a second, and only this filter needs it
    from filterpy.kalman import KalmanFilter  # noqa: PLC0415

    kf = KalmanFilter(dim_x=len(state), dim_z=len(H))
    kf.x, kf.P, kf.H = state.astype(object), covariance.astype(object), H
    kf.inv = lambda S: inverse(S.astype(float))
    return kf
