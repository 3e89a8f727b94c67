"""Adaptive measurement noise: the sensor's actual noise, estimated from innovations."""

from __future__ import annotations

import math

import numpy as np

from mecazen_follower.estimators.base import Array

MIN_FACTOR, MAX_FACTOR = 0.1, 1000.0
"""Bounds of the factors: beyond them the filter ignores its prediction or its sensor."""


class NoiseScale:
    """Factors on the reported variances: one for x and y, one for yaw.

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
