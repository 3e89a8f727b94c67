"""The constant velocity filter along the axes of odom."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen.schema import Positive

from mecazen_follower.estimators.base import Array, Estimate, Estimator, Params, as_tuple
from mecazen_follower.estimators.kalman import kalman, nis_of


class ConstantVelocityParams(Params):
    """Parameters of `kf_cv`.

    The accelerations are white noise. Each is given by the square root of its spectral density:
    the standard deviation of its mean over 1 s, which does not depend on the tick.
    """

    acceleration_std_m_s2: Positive = 0.2
    yaw_acceleration_std_rad_s2: Positive = 0.15
    initial_speed_std_m_s: Positive = 1.0
    """Prior of each component, since the first observation has no velocity."""
    initial_yaw_rate_std_rad_s: Positive = 0.5


class ConstantVelocityFilter(Estimator, name="kf_cv", params=ConstantVelocityParams):
    """Constant velocity in x, y and yaw, each disturbed by white acceleration.

    State [x, vx, y, vy, yaw, yaw rate] in odom; the observation is x, y and yaw. The model is
    from Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation,
    section 6.2.2, in its discretised continuous-time form: ten steps of 1 ms equal one of 10 ms.
    """

    _pose: ClassVar[list[int]] = [0, 2, 4]

    def __init__(self, params: ConstantVelocityParams) -> None:
        super().__init__(params)
        speed = params.initial_speed_std_m_s**2
        self._initial = speed, speed, params.initial_yaw_rate_std_rad_s**2
        linear = params.acceleration_std_m_s2**2
        self._densities = linear, linear, params.yaw_acceleration_std_rad_s2**2
        self._dt = 0.0
        self._F: Array = np.eye(6)
        self._Q: Array = np.zeros((6, 6))
        self.reset()

    def reset(self) -> None:
        """Discard the estimate."""
        self.nis = None
        self._filter: Any = None

    def predict(self, dt: float) -> None:
        """Propagate the estimate by `dt` [s] at its velocity."""
        if self._filter is None:
            return
        if dt != self._dt:
            self._dt = dt
            step = np.array([[1.0, dt], [0.0, 1.0]])
            from filterpy.common import (  # noqa: PLC0415  # as in `kalman`
                Q_continuous_white_noise,
            )

            noise = Q_continuous_white_noise(2, dt, 1.0)
            self._F = np.kron(np.eye(3), step)
            self._Q = np.kron(np.diag(self._densities), noise)
        self._filter.predict(F=self._F, Q=self._Q)
        self._filter.x[4] = wrap(float(self._filter.x[4]))

    def _observe(self, observation: Pose2D, noise: Array) -> None:
        if self._filter is None:
            state, covariance = np.zeros(6), np.zeros((6, 6))
            state[self._pose] = observation
            covariance[np.ix_(self._pose, self._pose)] = noise
            covariance[1, 1], covariance[3, 3], covariance[5, 5] = self._initial
            self._filter = kalman(state, covariance, np.eye(6)[self._pose])
            return
        kf = self._filter
        yaw = float(kf.x[4])
        unwrapped = yaw + wrap(observation.yaw - yaw)
        kf.update(np.array([observation.x, observation.y, unwrapped]), R=noise)
        kf.x[4] = wrap(float(kf.x[4]))
        self.nis = nis_of(kf)

    @property
    def estimate(self) -> Estimate | None:
        """The current estimate."""
        if self._filter is None:
            return None
        x, vx, y, vy, yaw, yaw_rate = self._filter.x.tolist()
        covariance = self._filter.P[::2, ::2]  # x, y and yaw precede their rates
        return Estimate(Pose2D(x, y, yaw), Twist2D(vx, vy, yaw_rate), as_tuple(covariance))
