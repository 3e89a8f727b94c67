"""Kalman filters of constant turn rate and velocity, also adaptive."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from mecazen.config.follower import CtrvParams, TurnRateParams
from mecazen.geometry import Pose2D

from mecazen_follower.estimators.base import (
    INITIAL_SPEED_STD_M_S,
    INITIAL_YAW_RATE_STD_RAD_S,
    Array,
    Estimate,
    Estimator,
)
from mecazen_follower.estimators.modes import Mode, ModeBank
from mecazen_follower.estimators.turn_rate import (
    SEEN,
    SIZE,
    Walks,
    estimate_of,
    unwrap_yaw,
)

MAX_STEP_S = 0.1
"""Longest step [s] for the first-order approximations of motion, noise and mode changes."""
MIN_POSITION_WALK = 0.001
"""Random walk of the position [m] after 1 s, in addition to sway and side steps."""
MIN_FACTOR, MAX_FACTOR = 0.1, 1000.0
"""Bounds of `NoiseScale`: beyond them the filter ignores its prediction or its sensor."""


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
    """A bank of modes that is propagated only when an observation comes.

    Between observations `ahead` predicts in closed form, which keeps most ticks cheap.
    """

    _begin: Callable[[Array, Array], ModeBank]
    """Returns a filter with an initial state (5) and its covariance (5, 5)."""

    def __init__(self, params: TurnRateParams) -> None:
        super().__init__(params)
        self._initial = INITIAL_SPEED_STD_M_S**2, INITIAL_YAW_RATE_STD_RAD_S**2
        self._noise_memory = params.noise_memory_s
        self.reset()

    def reset(self) -> None:
        """Discard the estimate."""
        self.nis = None
        self._filter: ModeBank | None = None
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
