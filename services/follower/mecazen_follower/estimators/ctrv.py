"""Filters of constant turn rate and velocity: extended and unscented."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, Protocol

import numpy as np
from mecazen.geometry import Pose2D
from mecazen.schema import NonNegative, Positive

from mecazen_follower.estimators.adaptive import NoiseScale
from mecazen_follower.estimators.base import Array, Estimate, Estimator, Params
from mecazen_follower.estimators.modes import Mode, ModeBank
from mecazen_follower.estimators.turn_rate import (
    IDENTITY,
    SEEN,
    SEES,
    SIZE,
    YAW,
    State,
    Triangle,
    Walks,
    carry,
    estimate_of,
    move,
    near,
    process_noise,
    triangle,
)

MAX_STEP_S = 0.1
"""Longest step over which motion, noise and modes are taken to first order."""


STEADY = 0.001
"""Random walk of the position [m] after 1 s of who neither sways nor steps aside."""


class StateFilter(Protocol):
    """A filter of the state of `turn_rate`."""

    nis: float

    @property
    def heading(self) -> float:
        """The state's heading [rad]; not wrapped."""

    @property
    def state(self) -> Array:
        """The state (5)."""

    @property
    def covariance(self) -> Array:
        """Its covariance (5, 5)."""

    def predict(self, dt: float) -> None:
        """Move by `dt` [s]."""

    def update(self, observation: Array, noise: Array) -> None:
        """Take in an observation (3) with its covariance (3, 3)."""

    def ahead(self, dt: float) -> tuple[State, Triangle]:
        """Return state and covariance `dt` [s] later, and now where it is 0."""


class TurnRateParams(Params):
    """What the filters of constant turn rate and velocity share.

    Random walks are given by the standard deviation that they have after 1 s.
    """

    sway_m_sqrt_m: Positive = 0.03
    """Of the position to all sides, by the way walked: its deviation after 1 m."""
    initial_speed_std_m_s: Positive = 1.0
    """At the first observation, which tells nothing of the velocity."""
    initial_yaw_rate_std_rad_s: Positive = 0.5
    noise_memory_s: NonNegative = 0.0
    """Time over which the sensor's real noise is learnt; at 0 it is taken to be as told."""


class TurnRateEstimator(Estimator):
    """A `StateFilter` that is moved on when an observation comes.

    Between observations its state is carried ahead, which leaves most ticks cheap.
    """

    def __init__(self, params: TurnRateParams) -> None:
        super().__init__(params)
        self._initial = params.initial_speed_std_m_s**2, params.initial_yaw_rate_std_rad_s**2
        self._noise_memory = params.noise_memory_s
        self.reset()

    @abstractmethod
    def _begin(self, state: Array, covariance: Array) -> StateFilter:
        """Return the filter that starts with a state (5) and its covariance (5, 5)."""

    def reset(self) -> None:
        """Forget the person."""
        self.nis = None
        self._filter: StateFilter | None = None
        self._elapsed = 0.0
        self._since_seen = 0.0
        self._scale = NoiseScale(self._noise_memory)

    def predict(self, dt: float) -> None:
        """Go ahead by `dt` [s]."""
        self._elapsed += dt
        self._since_seen += dt
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
        seen = near(self._filter.heading, observation)
        if self._noise_memory > 0.0:
            innovation = seen - self._filter.state[:SEEN]
            prediction = self._filter.covariance[:SEEN, :SEEN]
            noise = self._scale.learn(innovation, prediction, noise, self._since_seen)
        self._since_seen = 0.0
        self._filter.update(seen, noise)
        self.nis = self._filter.nis

    @property
    def estimate(self) -> Estimate | None:
        """The person now."""
        return self.ahead(0.0)

    def ahead(self, dt: float) -> Estimate | None:
        """Return the person `dt` [s] from now, with the uncertainty that comes with it."""
        if self._filter is None:
            return None
        return estimate_of(*self._filter.ahead(self._elapsed + dt))


class CtrvParams(TurnRateParams):
    """Parameters of `ekf_ctrv` and `ukf_ctrv`."""

    acceleration_std_m_s2: Positive = 0.3
    """Of the speed."""
    yaw_acceleration_std_rad_s2: Positive = 0.3
    """Of the turn rate."""

    @property
    def walks(self) -> Walks:
        """The random walks, as `turn_rate.process_noise` wants them."""
        acceleration, turning = self.acceleration_std_m_s2, self.yaw_acceleration_std_rad_s2
        return self.sway_m_sqrt_m, STEADY, 0.0, acceleration, turning


class ExtendedFilter(TurnRateEstimator, name="ekf_ctrv", params=CtrvParams):
    """An extended Kalman filter of constant turn rate and velocity."""

    def __init__(self, params: CtrvParams) -> None:
        self._mode = Mode(params.walks)
        super().__init__(params)

    def _begin(self, state: Array, covariance: Array) -> StateFilter:
        return ModeBank((self._mode,), state, covariance)


class Unscented:
    """An unscented Kalman filter of the state of `turn_rate`.

    Sigma points by R. van der Merwe: Sigma-Point Kalman Filters for Probabilistic Inference
    in Dynamic State-Space Models (2004).
    """

    def __init__(self, walks: Walks, state: Array, covariance: Array) -> None:
        from filterpy.kalman import (  # noqa: PLC0415  # as in `kalman`
            MerweScaledSigmaPoints,
            UnscentedKalmanFilter,
        )

        self._walks = walks
        points = MerweScaledSigmaPoints(SIZE, alpha=0.5, beta=2.0, kappa=0.0)
        self._filter: Any = UnscentedKalmanFilter(
            SIZE, SEEN, dt=0.0, hx=lambda x: x[:SEEN], fx=move, points=points
        )
        self._filter.x, self._filter.P = state, covariance
        self.nis = 0.0

    @property
    def heading(self) -> float:
        """The state's heading [rad]; not wrapped."""
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
        """Move by `dt` [s]."""
        self._filter.Q = process_noise(self._walks, self.state, dt)
        self._filter.predict(dt=dt)

    def update(self, observation: Array, noise: Array) -> None:
        """Take in an observation (3) with its covariance (3, 3)."""
        kf = self._filter
        kf.compute_process_sigmas(0.0)  # of the present, even if nothing moved since
        prediction = kf.P
        kf.update(observation, R=noise)
        keeps = IDENTITY - kf.K @ SEES
        # Joseph's form, since what is seen is linear in the state: see ModeBank
        P = keeps @ prediction @ keeps.T + kf.K @ noise @ kf.K.T
        kf.P = (P + P.T) / 2.0
        self.nis = float(kf.y @ kf.SI @ kf.y)

    def ahead(self, dt: float) -> tuple[State, Triangle]:
        """Return state and covariance `dt` [s] later, to first order."""
        return carry(tuple(self.state.tolist()), triangle(self.covariance), self._walks, dt)


class UnscentedFilter(TurnRateEstimator, name="ukf_ctrv", params=CtrvParams):
    """An unscented Kalman filter of constant turn rate and velocity."""

    def __init__(self, params: CtrvParams) -> None:
        self._walks = params.walks
        super().__init__(params)

    def _begin(self, state: Array, covariance: Array) -> StateFilter:
        return Unscented(self._walks, state, covariance)
