"""What every estimator is: an abstract base, its estimate, and the registry by name."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt
from mecazen.covariance import PlanarCovariance
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen.schema import Positive, Section

from mecazen_follower.estimators.symmetric import Rows, factors

Array = npt.NDArray[np.float64]

MAX_DISTANCE = 1e6
"""Largest coordinate of an observation [m]: beyond it the arithmetic loses millimetres."""
LEAST_NOISE: Array = 2e-12 * np.eye(3)
"""Added to an observation's [m², rad²]: a perfect sensor must not make a matrix singular."""


class Estimate(NamedTuple):
    """The person in odom: pose, velocity along odom's axes, covariance of the pose."""

    pose: Pose2D
    velocity: Twist2D
    covariance: PlanarCovariance

    def after(self, dt: float) -> Estimate:
        """Return the estimate `dt` [s] later, if the person keeps walking and turning."""
        if dt == 0.0:
            return self
        body = Twist2D(*rotate(self.velocity.x, self.velocity.y, -self.pose.yaw), self.velocity.yaw)
        pose = self.pose.integrate(body, dt)
        velocity = Twist2D(*rotate(body.x, body.y, pose.yaw), body.yaw)
        return Estimate(pose, velocity, self.covariance)


class Params(Section):
    """What every estimator can be told: the noise of a sensor that does not tell it."""

    position_std_m: Positive = 0.05
    yaw_std_deg: Positive = 5.0


class Estimator(ABC):
    """Tracks one person: `predict` at every tick, `update` when an observation comes.

    A subclass is registered under its `name`, unless it is a base itself; `params` is the
    struct of its parameters, which are numbers.

    Attributes:
        nis: Normalised innovation squared of the last update; chi-square with as many
            degrees of freedom as the filter observes if its model is right. None where
            there is none.
    """

    registry: ClassVar[dict[str, type[Estimator]]] = {}
    params_type: ClassVar[type[Params]] = Params

    def __init_subclass__(cls, name: str | None = None, params: type[Params] = Params) -> None:
        cls.params_type = params
        if name is not None:
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
        if covariance is None:
            return self._default_noise
        noise = np.asarray(covariance, float)
        rows = noise.tolist()
        if noise.shape != (3, 3) or not _is_within(rows, MAX_DISTANCE**2):
            raise ValueError("covariance of an observation must be 3x3 and finite")
        if not any(map(any, rows)):
            return self._default_noise
        positive = noise + LEAST_NOISE
        if not (_is_symmetric(rows) and _is_positive(positive.tolist())):
            raise ValueError("covariance of an observation must be symmetric and not negative")
        return positive

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

    def ahead(self, dt: float) -> Estimate | None:
        """Return the person `dt` [s] from now: makes up for a latency."""
        person = self.estimate
        return None if person is None else person.after(dt)

    @abstractmethod
    def reset(self) -> None:
        """Forget the person."""


def _is_within(matrix: Rows, limit: float) -> bool:
    return all(abs(number) <= limit for row in matrix for number in row)


def _is_symmetric(matrix: Rows) -> bool:
    """Return whether a 3x3 matrix is symmetric, but for the digits of a single float."""
    (_, xy, xw), (yx, _, yw), (wx, wy, _) = matrix
    return all(
        math.isclose(one, other, rel_tol=1e-5, abs_tol=1e-8)
        for one, other in ((xy, yx), (xw, wx), (yw, wy))
    )


def _is_positive(matrix: Rows) -> bool:
    """Return whether a symmetric 3x3 matrix is positive definite."""
    try:
        factors(matrix)
    except ValueError:
        return False
    return True


def make_params(name: str, params: Mapping[str, float]) -> Params:
    """Return all parameters of the estimator of that name: the given ones, else defaults.

    Raises:
        ValueError: There is none of that name, or it does not take these parameters.
    """
    if name not in Estimator.registry:
        raise ValueError(
            f"unknown estimator {name!r}, allowed: {', '.join(sorted(Estimator.registry))}"
        )
    kind = Estimator.registry[name].params_type
    unknown = params.keys() - set(kind.__struct_fields__)
    if unknown:
        raise ValueError(
            f"{name} has no parameter {', '.join(sorted(unknown))}, "
            f"allowed: {', '.join(kind.__struct_fields__)}"
        )
    return msgspec.convert(params, kind)
