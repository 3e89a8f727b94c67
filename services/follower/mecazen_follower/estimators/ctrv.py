"""Kalman filters of constant turn rate and velocity: extended and unscented, also adaptive."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from mecazen.config.estimators import CtrvParams, TurnRateParams
from mecazen.geometry import Pose2D
from mecazen.portable import product

from mecazen_follower.estimators.base import Array, Estimate, Estimator
from mecazen_follower.estimators.modes import Mode, ModeBank
from mecazen_follower.estimators.turn_rate import (
    IDENTITY,
    OBSERVATION,
    SEEN,
    SIZE,
    YAW,
    State,
    Triangle,
    Walks,
    estimate_of,
    move,
    process_noise,
    propagate,
    triangle,
    unwrap_yaw,
)

MAX_STEP_S = 0.1
"""Longest step for the first-order approximations of motion, noise and mode changes."""
MIN_POSITION_WALK = 0.001
"""Random walk of the position [m] after 1 s besides sway and side steps."""
MIN_FACTOR, MAX_FACTOR = 0.1, 1000.0
"""Bounds of `NoiseScale`: beyond them the filter ignores its prediction or its sensor."""


class Unscented:
    """An unscented Kalman filter of the state of `turn_rate`.

    Sigma points by R. van der Merwe: Sigma-Point Kalman Filters for Probabilistic Inference
    in Dynamic State-Space Models (2004).
    """

    def __init__(self, walks: Walks, state: Array, covariance: Array) -> None:
        from filterpy import kalman  # noqa: PLC0415  # late, as it takes a second

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
        """Its covariance (5, 5)."""
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
        remaining = IDENTITY - product(kf.K, OBSERVATION)
        # Joseph form, possible since the observation is linear in the state
        P = product(product(remaining, prediction), remaining.T)
        P += product(product(kf.K, noise), kf.K.T)
        kf.P = (P + P.T) / 2.0
        self.nis = float(np.sum(kf.y * product(kf.SI, kf.y)))

    def ahead(self, dt: float) -> tuple[State, Triangle]:
        """Return state and covariance `dt` [s] later, to first order."""
        return propagate(tuple(self.state.tolist()), triangle(self.covariance), self._walks, dt)


StateFilter = ModeBank | Unscented
"""A filter of the state of `turn_rate`."""


class NoiseScale:
    """The sensor's actual noise: factors on the reported variances of x and y, and of yaw.

    The variance of an innovation is the sum of the variances of observation and prediction
    (R. K. Mehra: On the identification of variances and adaptive Kalman filtering, IEEE
    Trans. Automatic Control 15, 1970). The mean square of the innovations minus the variance
    of the prediction estimates the variance of the observation. The mean is exponential, with
    the time constant `memory` [s].
    """

    def __init__(self, memory: float) -> None:
        self._memory = memory
        self.factors: tuple[float, float] = 1.0, 1.0
        """Factors on the variances of position and yaw."""

    def learn(self, innovation: Array, prediction: Array, noise: Array, dt: float) -> Array:
        """Return the covariance (3, 3) of an observation, after learning from its innovation.

        Args:
            innovation: Observation minus prediction (3).
            prediction: The covariance (3, 3) of the prediction.
            noise: The covariance (3, 3) that the sensor reports.
            dt: Time since the last observation [s].
        """
        weight = -math.expm1(-dt / self._memory)
        excess = np.square(innovation) - np.diag(prediction)
        reported = np.diag(noise)
        ratios = (excess[0] + excess[1]) / (reported[0] + reported[1]), excess[2] / reported[2]
        position, yaw = (
            min(max(old + weight * (float(new) - old), MIN_FACTOR), MAX_FACTOR)
            for old, new in zip(self.factors, ratios, strict=True)
        )
        self.factors = position, yaw
        root = np.sqrt([position, position, yaw])
        return noise * root[:, None] * root


class TurnRateEstimator(Estimator):
    """A `StateFilter` that is propagated only when an observation comes.

    Between observations `ahead` predicts in closed form, which keeps most ticks cheap.
    """

    _begin: Callable[[Array, Array], StateFilter]
    """Returns a filter with an initial state (5) and its covariance (5, 5)."""

    def __init__(self, params: TurnRateParams) -> None:
        super().__init__(params)
        self._initial = params.initial_speed_std_m_s**2, params.initial_yaw_rate_std_rad_s**2
        self._noise_memory = params.noise_memory_s
        self.reset()

    def reset(self) -> None:
        """Discard the estimate."""
        self.nis = None
        self._filter: StateFilter | None = None
        self._elapsed = 0.0
        self._since_observed = 0.0
        self._scale = NoiseScale(self._noise_memory)

    def predict(self, dt: float) -> None:
        """Propagate by `dt` [s]."""
        self._elapsed += dt
        self._since_observed += dt
        if self._elapsed >= MAX_STEP_S:
            self._catch_up()

    def _catch_up(self) -> None:
        if self._filter is not None and self._elapsed > 0.0:
            steps = math.ceil(self._elapsed / MAX_STEP_S - 1e-9)
            for _ in range(steps):
                self._filter.predict(self._elapsed / steps)
        self._elapsed = 0.0

    def _observe(self, observation: Pose2D, noise: Array) -> None:
        self._catch_up()
        if self._filter is None:
            covariance = np.zeros((SIZE, SIZE))
            covariance[:SEEN, :SEEN] = noise
            covariance[range(SEEN, SIZE), range(SEEN, SIZE)] = self._initial
            self._filter = self._begin(np.array([*observation, 0.0, 0.0]), covariance)
            return
        unwrapped = unwrap_yaw(self._filter.heading, observation)
        if self._noise_memory > 0.0:
            innovation = unwrapped - self._filter.state[:SEEN]
            prediction = self._filter.covariance[:SEEN, :SEEN]
            noise = self._scale.learn(innovation, prediction, noise, self._since_observed)
        self._since_observed = 0.0
        self._filter.update(unwrapped, noise)
        self.nis = self._filter.nis

    @property
    def estimate(self) -> Estimate | None:
        """The current estimate."""
        return self.ahead(0.0)

    def ahead(self, dt: float) -> Estimate | None:
        """Return the estimate `dt` [s] from now, with its propagated covariance."""
        if self._filter is None:
            return None
        return estimate_of(*self._filter.ahead(self._elapsed + dt))


def walks_of(params: CtrvParams) -> Walks:
    """Return the random walks for `turn_rate.process_noise`."""
    acceleration, turning = params.acceleration_std_m_s2, params.yaw_acceleration_std_rad_s2
    return params.sway_m_sqrt_m, MIN_POSITION_WALK, 0.0, acceleration, turning


class ExtendedFilter(TurnRateEstimator, name="ekf_ctrv"):
    """An extended Kalman filter of constant turn rate and velocity."""

    def __init__(self, params: CtrvParams) -> None:
        super().__init__(params)
        self._begin = partial(ModeBank, (Mode(walks_of(params)),))


class UnscentedFilter(TurnRateEstimator, name="ukf_ctrv"):
    """An unscented Kalman filter of constant turn rate and velocity."""

    def __init__(self, params: CtrvParams) -> None:
        super().__init__(params)
        self._begin = partial(Unscented, walks_of(params))
