"""The abstract base of all estimators, their estimate, the registry, and the simplest estimator."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.config.follower import PARAMS, Params, make_params
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.messages import PlanarCovariance

Array = npt.NDArray[np.float64]

INITIAL_SPEED_STD_M_S, INITIAL_YAW_RATE_STD_RAD_S = 1.0, 0.5
"""Prior of each velocity, since the first observation has none."""
MIN_NOISE: Array = 2e-12 * np.eye(3)
"""Added to the covariance of an observation [m², rad²], so that none is singular."""


class Estimate(NamedTuple):
    """The person in odom: pose, velocity along odom's axes, covariance of the pose."""

    pose: Pose2D
    velocity: Twist2D
    covariance: PlanarCovariance

    def after(self, dt: float) -> Estimate:
        """Return the estimate `dt` [s] later at constant body twist; the covariance stays."""
        if dt == 0.0:
            return self
        body = Twist2D(*rotate(self.velocity.x, self.velocity.y, -self.pose.yaw), self.velocity.yaw)
        pose = self.pose.integrate(body, dt)
        velocity = Twist2D(*rotate(body.x, body.y, pose.yaw), body.yaw)
        return Estimate(pose, velocity, self.covariance)


class Estimator(ABC):
    """Tracks one person: `predict` at every tick, `update` with every observation.

    A subclass is registered under its `name`; a subclass without a name is a base class. `params`
    is the struct of its numeric parameters, unless `mecazen.config.follower` defines the struct.

    Attributes:
        nis: Normalised innovation squared of the last update, None before the first update. With a
            correct model it is chi-square, with one degree of freedom per observed component.
    """

    registry: ClassVar[dict[str, type[Estimator]]] = {}
    predicts: ClassVar[bool] = True
    """Whether the covariance grows with time, so that a gate can reject other people."""

    def __init_subclass__(cls, name: str | None = None, params: type[Params] = Params) -> None:
        if name is not None:
            Estimator.registry[name] = cls
            PARAMS.setdefault(name, params)

    def __init__(self, params: Params) -> None:
        self.nis: float | None = None
        std = params.position_std_m, params.position_std_m, math.radians(params.yaw_std_deg)
        self._default_noise: Array = np.diag(np.square(std))

    def update(self, observation: Pose2D, covariance: npt.ArrayLike | None = None) -> None:
        """Correct the estimate with an observed pose in odom and its 3x3 covariance.

        Both are finite, and the covariance is symmetric and positive semidefinite: see
        `measurement.check`.
        """
        self._observe(observation, self.noise(covariance))

    def noise(self, covariance: npt.ArrayLike | None) -> Array:
        """Return the covariance (3, 3) that `update` assumes.

        A covariance of None or all zeros is unknown, as in ROS; the noise of the parameters
        replaces it.
        """
        if covariance is None:
            return self._default_noise
        noise = np.asarray(covariance, float)
        return noise + MIN_NOISE if noise.any() else self._default_noise

    @abstractmethod
    def _observe(self, observation: Pose2D, noise: Array) -> None:
        """Correct the estimate with an observation and its positive definite covariance."""

    @abstractmethod
    def predict(self, dt: float) -> None:
        """Propagate the estimate by `dt` [s] > 0; no effect before the first observation."""

    @property
    @abstractmethod
    def estimate(self) -> Estimate | None:
        """The current estimate; None before the first observation."""

    def ahead(self, dt: float) -> Estimate | None:
        """Return the estimate `dt` [s] from now, which compensates a latency."""
        person = self.estimate
        return None if person is None else person.after(dt)

    @abstractmethod
    def reset(self) -> None:
        """Discard the estimate."""


class RawObservation(Estimator, name="none"):
    """The last observation, held until the next one, with zero velocity."""

    predicts = False
    estimate: Estimate | None = None

    def predict(self, dt: float) -> None:
        """Hold the last observation."""

    def _observe(self, observation: Pose2D, noise: Array) -> None:
        self.estimate = Estimate(observation, Twist2D(), as_tuple(noise))

    def reset(self) -> None:
        self.estimate = None


def as_tuple(matrix: Array) -> PlanarCovariance:
    """Return a covariance (3, 3) as plain floats."""
    return tuple(map(tuple, matrix.tolist()))


def make_estimator(name: str, params: Mapping[str, float]) -> Estimator:
    """Return a new estimator by its name; parameters that are not given have their defaults.

    Raises:
        ValueError: The name or a parameter is unknown.
    """
    return Estimator.registry[name](make_params(name, params))
