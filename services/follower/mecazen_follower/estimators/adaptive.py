"""Adaptive measurement noise: what the sensor's noise really is, learnt from innovations."""

from __future__ import annotations

import math

import numpy as np

from mecazen_follower.estimators.base import Array

LEAST, MOST = 0.1, 1000.0
"""Bounds of the factors: a filter that trusts wholly, or not at all, learns no more."""


class NoiseScale:
    """Factors on the told variances: one for x and y, one for yaw.

    The variance of an innovation is that of the observation plus that of the prediction
    (R. K. Mehra: On the identification of variances and adaptive Kalman filtering, IEEE
    Trans. Automatic Control 15, 1970). What the innovations' mean square has beyond the
    prediction's is taken for the observation's, forgotten exponentially over `memory` [s].
    """

    def __init__(self, memory: float) -> None:
        self._memory = memory
        self.factors: tuple[float, float] = 1.0, 1.0
        """Of the position's variance, and of the yaw's."""

    def learn(self, innovation: Array, prediction: Array, noise: Array, dt: float) -> Array:
        """Return the covariance (3, 3) to expect of an observation that was told `noise`.

        Args:
            innovation: Observed less predicted (3).
            prediction: The covariance (3, 3) of what was predicted.
            noise: The covariance (3, 3) that the sensor tells.
            dt: Time since the observation before [s].
        """
        weight = -math.expm1(-dt / self._memory)
        excess = np.square(innovation) - np.diag(prediction)
        told = np.diag(noise)
        seen = (excess[0] + excess[1]) / (told[0] + told[1]), excess[2] / told[2]
        position, yaw = (
            min(max(old + weight * (float(new) - old), LEAST), MOST)
            for old, new in zip(self.factors, seen, strict=True)
        )
        self.factors = position, yaw
        root = np.sqrt([position, position, yaw])
        return noise * root[:, None] * root
