"""Estimators of the person's pose and velocity in odom, from noisy observations.

To add one: subclass `Estimator` with a name; a scenario can then ask for it by that name.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen.schema import NonNegative, Positive, Section

Array = npt.NDArray[np.float64]
Covariance = tuple[tuple[float, float, float], ...]
"""3x3, of x [m], y [m] and yaw [rad]."""

MAX_DISTANCE = 1e6
"""Largest coordinate of an observation [m]: beyond it the arithmetic loses millimetres."""
MIN_VARIANCE = 1e-12
"""Added to an observation's [m², rad²]: a perfect sensor must not make a matrix singular."""


class Estimate(NamedTuple):
    """The person in odom: pose, velocity along odom's axes, covariance of the pose."""

    pose: Pose2D
    velocity: Twist2D
    covariance: Covariance

    def ahead(self, dt: float) -> Pose2D:
        """Return the pose `dt` [s] later, at constant velocity: makes up for a latency."""
        return Pose2D(
            self.pose.x + self.velocity.x * dt,
            self.pose.y + self.velocity.y * dt,
            wrap(self.pose.yaw + self.velocity.yaw * dt),
        )


class Params(Section):
    """What every estimator can be told: the noise of a sensor that does not tell it."""

    position_std_m: Positive = 0.05
    yaw_std_deg: Positive = 5.0


class Estimator(ABC):
    """Tracks one person: `predict` at every tick, `update` when an observation comes.

    A subclass is registered under its `name`; `params` is the struct of its parameters,
    which are numbers.

    Attributes:
        nis: Normalised innovation squared of the last update; chi-square with as many
            degrees of freedom as the filter observes if its model is right. None where
            there is none.
    """

    registry: ClassVar[dict[str, type[Estimator]]] = {}
    params_type: ClassVar[type[Params]] = Params

    def __init_subclass__(cls, name: str, params: type[Params] = Params) -> None:
        cls.params_type = params
        Estimator.registry[name] = cls

    def __init__(self, params: Params) -> None:
        self.nis: float | None = None
        std = params.position_std_m, params.position_std_m, math.radians(params.yaw_std_deg)
        self._default_noise: Array = np.diag(np.square(std))

    def update(self, observation: Pose2D, covariance: npt.ArrayLike | None = None) -> None:
        """Take in an observed pose in odom, and its 3x3 covariance of x, y, yaw.

        A covariance of None or all zeros is unknown, as in ROS: the parameters' noise is
        taken.

        Raises:
            ValueError: The observation is not finite or farther than 1000 km, or the
                covariance is no covariance. The estimate stays as it was.
        """
        if not all(abs(number) <= MAX_DISTANCE for number in observation):
            raise ValueError(f"observation is out of range: {tuple(observation)}")
        self._observe(observation, self._noise(covariance))

    def _noise(self, covariance: npt.ArrayLike | None) -> Array:
        noise = self._default_noise if covariance is None else np.asarray(covariance, float)
        if noise.shape != (3, 3) or not (np.abs(noise) <= MAX_DISTANCE**2).all():
            raise ValueError("covariance of an observation must be 3x3 and finite")
        if not noise.any():
            return self._default_noise
        if not np.allclose(noise, noise.T) or np.linalg.eigvalsh(noise)[0] < -MIN_VARIANCE:
            raise ValueError("covariance of an observation must be symmetric and not negative")
        return noise + 2 * MIN_VARIANCE * np.eye(3)

    @abstractmethod
    def _observe(self, observation: Pose2D, noise: Array) -> None:
        """Take in an observation with its positive definite covariance."""

    @abstractmethod
    def predict(self, dt: float) -> None:
        """Go ahead in time by `dt` [s] > 0; nothing happens before the first observation."""

    @property
    @abstractmethod
    def estimate(self) -> Estimate | None:
        """The person now; None before the first observation."""

    @abstractmethod
    def reset(self) -> None:
        """Forget the person."""


ESTIMATORS = Estimator.registry
"""Every estimator, by its name in a scenario."""


def make_params(name: str, params: Mapping[str, float]) -> Params:
    """Return all parameters of the estimator of that name: the given ones, else defaults.

    Raises:
        ValueError: There is none of that name, or it does not take these parameters.
    """
    if name not in ESTIMATORS:
        raise ValueError(f"unknown estimator {name!r}, allowed: {', '.join(sorted(ESTIMATORS))}")
    kind = ESTIMATORS[name].params_type
    unknown = params.keys() - set(kind.__struct_fields__)
    if unknown:
        raise ValueError(
            f"{name} has no parameter {', '.join(sorted(unknown))}, "
            f"allowed: {', '.join(kind.__struct_fields__)}"
        )
    return msgspec.convert(params, kind)


class RawObservation(Estimator, name="none"):
    """The last observation as it came, held until the next; the velocity is taken as zero."""

    _estimate: Estimate | None = None

    def predict(self, dt: float) -> None:
        """Hold the last observation."""

    def _observe(self, observation: Pose2D, noise: Array) -> None:
        self._estimate = Estimate(observation, Twist2D(), _covariance(noise))

    @property
    def estimate(self) -> Estimate | None:
        """The last observation."""
        return self._estimate

    def reset(self) -> None:
        """Forget the last observation."""
        self._estimate = None


class DisplacementParams(Params):
    """Parameters of `kf_displacement`."""

    position_drift_m_sqrt_s: Positive = 0.1
    """Random walk of the position besides the displacement: its deviation after 1 s."""
    smoothing_s: Positive = 1.0
    """Time constant with which the displacement is smoothed."""
    min_speed_m_s: NonNegative = 0.08
    """Below it, the direction of the displacement says nothing of the heading."""


class DisplacementFilter(Estimator, name="kf_displacement", params=DisplacementParams):
    """The published filter of "A Virtual Mecanum Wheeled Robot ROS Simulator ...".

    What is written there: X_k = F X_(k-1) + w (1), y_k = H X_(k-1) + u (2), with the state
    X = [x, y, yaw], and (4)

        F = [[1, 0, Δx], [0, 1, Δy], [0, 0, 1]],  H = [1, 1, 0],

    where Δx, Δy are "the displacement per unit time".

    Why it cannot be literal: F X moves the person by yaw times Δ, so one who walks at
    yaw = 0 would stand still; and H X = x + y is one number, from which x and y cannot be
    told apart.

    How it is read: F is the homogeneous matrix of a translation and acts on (x, y, 1), that
    is x += Δx, y += Δy: a constant input, which leaves the covariance to grow by Q alone.
    H is the diagonal of the matrix that selects what is observed: rows for x and y and none
    for the yaw, H = [[1, 0, 0], [0, 1, 0]]. y_k is taken to observe X_k.

    Δ per second is the displacement from one corrected estimate to the next, exponentially
    smoothed over `smoothing_s`. The yaw, which nothing in the filter corrects, is what the
    paper defines it to be, the direction of motion: that of Δ. Where the person is too slow
    to have one, it is the observed yaw, smoothed likewise. The yaw rate is taken as zero
    (the third row of F).
    """

    def __init__(self, params: DisplacementParams) -> None:
        super().__init__(params)
        self._drift = params.position_drift_m_sqrt_s**2
        self._smoothing = params.smoothing_s
        self._min_speed = params.min_speed_m_s
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self.nis = None
        self._filter: Any = None
        self._velocity: Array = np.zeros(3)
        self._corrected: Array = np.zeros(3)
        self._elapsed = 0.0

    def predict(self, dt: float) -> None:
        """Move by the displacement per second times `dt` [s]."""
        if self._filter is None:
            return
        drift = self._drift * dt
        self._filter.predict(u=self._velocity * dt, B=np.eye(3), Q=np.diag([drift, drift, 0.0]))
        self._elapsed += dt

    def _observe(self, observation: Pose2D, noise: Array) -> None:
        if self._filter is None:
            self._filter = _kalman(np.array(observation), noise, np.eye(2, 3))
            self._corrected = np.array(observation)
            return
        kf = self._filter
        kf.update(np.array(observation[:2]), R=noise[:2, :2])
        self.nis = _nis(kf)
        if self._elapsed > 0.0:
            weight = -math.expm1(-self._elapsed / self._smoothing)
            displacement = (kf.x - self._corrected) / self._elapsed
            displacement[2] = 0.0
            self._velocity += weight * (displacement - self._velocity)
            kf.x[2] = self._yaw(float(kf.x[2]), observation.yaw, weight)
        kf.P[2, 2] = noise[2, 2]  # the filter knows nothing of it: as good as one observation
        self._corrected = kf.x.copy()
        self._elapsed = 0.0

    def _yaw(self, yaw: float, observed: float, weight: float) -> float:
        vx, vy = self._velocity[:2]
        if math.hypot(vx, vy) > self._min_speed:
            return math.atan2(vy, vx)
        return wrap(yaw + weight * wrap(observed - yaw))

    @property
    def estimate(self) -> Estimate | None:
        """The person now, with the smoothed displacement per second as velocity."""
        if self._filter is None:
            return None
        x, y, yaw = self._filter.x.tolist()
        vx, vy, _ = self._velocity.tolist()
        return Estimate(Pose2D(x, y, yaw), Twist2D(vx, vy, 0.0), _covariance(self._filter.P))


class ConstantVelocityParams(Params):
    """Parameters of `kf_cv`.

    The accelerations are white noise. Each is given by the deviation of its mean over one
    second (the square root of its spectral density), which does not depend on the tick.
    """

    acceleration_std_m_s2: Positive = 0.2
    yaw_acceleration_std_rad_s2: Positive = 0.15
    initial_speed_std_m_s: Positive = 1.0
    """Of each component at the first observation, which tells nothing of the velocity."""
    initial_yaw_rate_std_rad_s: Positive = 0.5


class ConstantVelocityFilter(Estimator, name="kf_cv", params=ConstantVelocityParams):
    """Constant velocity in x, y and yaw, each disturbed by white acceleration.

    State [x, vx, y, vy, yaw, yaw rate] in odom; the observation is x, y and yaw. The model
    is of Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and
    Navigation, section 6.2.2. The continuous one, so that ten steps of 1 ms and one of 10 ms
    give the same.
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
        """Forget the person."""
        self.nis = None
        self._filter: Any = None

    def predict(self, dt: float) -> None:
        """Move with the estimated velocity for `dt` [s]."""
        if self._filter is None:
            return
        if dt != self._dt:
            self._dt = dt
            step = np.array([[1.0, dt], [0.0, 1.0]])
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
            self._filter = _kalman(state, covariance, np.eye(6)[self._pose])
            return
        kf = self._filter
        yaw = float(kf.x[4])
        # The turn of the observed yaw that is nearest to the state: the innovation wraps.
        near = yaw + wrap(observation.yaw - yaw)
        kf.update(np.array([observation.x, observation.y, near]), R=noise)
        kf.x[4] = wrap(float(kf.x[4]))
        self.nis = _nis(kf)

    @property
    def estimate(self) -> Estimate | None:
        """The person now."""
        if self._filter is None:
            return None
        x, vx, y, vy, yaw, yaw_rate = self._filter.x.tolist()
        covariance = self._filter.P[::2, ::2]  # x, y, yaw stand before their rates
        return Estimate(Pose2D(x, y, yaw), Twist2D(vx, vy, yaw_rate), _covariance(covariance))


def _kalman(state: Array, covariance: Array, H: Array) -> Any:
    """Return a filter that starts with `state`, a vector, and observes H times it."""
    kf = KalmanFilter(dim_x=len(state), dim_z=len(H))
    kf.x, kf.P, kf.H = state, covariance, H
    return kf


def _nis(kf: Any) -> float:
    return float(kf.y @ kf.SI @ kf.y)


def _covariance(matrix: Array) -> Covariance:
    return tuple((x, y, yaw) for x, y, yaw in matrix.tolist())
