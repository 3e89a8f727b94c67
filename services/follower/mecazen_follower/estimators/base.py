"""The abstract base of all estimators, their estimate, the registry, and the simplest of them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.config.estimators import PARAMS, Params, make_params
from mecazen.covariance import PlanarCovariance
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.limits import FARTHEST_M

from mecazen_follower.estimators.symmetric import Rows, is_positive

Array = npt.NDArray[np.float64]

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

    A subclass is registered under its `name`; one without a name is a base class. `params` is
    the struct of its parameters, which are numbers, unless `mecazen.config.estimators` has it.

    Attributes:
        nis: Normalised innovation squared of the last update, None before it. If the model is
            right it is chi-square, with a degree of freedom per observed component.
    """

    registry: ClassVar[dict[str, type[Estimator]]] = {}
    predicts: ClassVar[bool] = True
    """Whether its covariance grows with time, so that it tells who can't be the person."""

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

        A covariance of None or all zeros is unknown, as in ROS; the noise of the parameters
        replaces it.

        Raises:
            ValueError: The observation is not finite or farther than 1000 km, or the
                covariance is invalid. The estimate is unchanged.
        """
        self._observe(observation, self.noise(observation, covariance))

    def noise(self, observation: Pose2D, covariance: npt.ArrayLike | None) -> Array:
        """Return the covariance (3, 3) that `update` assumes; raises as it does."""
        if not all(abs(number) <= FARTHEST_M for number in observation):
            raise ValueError(f"observation is out of range: {tuple(observation)}")
        if covariance is None:
            return self._default_noise
        noise = np.asarray(covariance, float)
        rows = noise.tolist()
        if noise.shape != (3, 3) or not all(
            abs(number) <= FARTHEST_M**2 for row in rows for number in row
        ):
            raise ValueError("covariance of an observation must be 3x3 and finite")
        if not any(map(any, rows)):
            return self._default_noise
        positive = noise + MIN_NOISE
        if not (_is_symmetric(rows) and is_positive(positive.tolist())):
            required = "symmetric and positive semidefinite"
            raise ValueError(f"covariance of an observation must be {required}")
        return positive

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
        """Discard the last observation."""
        self.estimate = None


def as_tuple(matrix: Array) -> PlanarCovariance:
    """Return a covariance (3, 3) as plain floats."""
    return tuple(map(tuple, matrix.tolist()))


def _is_symmetric(matrix: Rows) -> bool:
    """Return whether a 3x3 matrix is symmetric to single precision."""
    (_, xy, xw), (yx, _, yw), (wx, wy, _) = matrix
    return all(
        math.isclose(one, other, rel_tol=1e-5, abs_tol=1e-8)
        for one, other in ((xy, yx), (xw, wx), (yw, wy))
    )


def make_estimator(name: str, params: Mapping[str, float]) -> Estimator:
    """Return a new estimator by its name; parameters that are not given have their defaults.

    Raises:
        ValueError: The name or a parameter is unknown.
    """
    return Estimator.registry[name](make_params(name, params))
