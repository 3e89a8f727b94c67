"""A smoother: what could have been known of the person with all observations at hand.

It sees the same observations as the filter, those after an instant included, and so bounds
what any filter of this model can reach.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.geometry import Pose2D
from mecazen_follower.estimators.turn_rate import (
    SEEN,
    SIZE,
    YAW,
    Walks,
    X,
    Y,
    jacobian,
    move,
    process_noise,
    unwrap_yaw,
)

from mecazen_experiments.poses import Poses, wrap

Array = npt.NDArray[np.float64]


class Sight(NamedTuple):
    """An observed pose at a time [s] > that of the one before, and its covariance (3, 3)."""

    time: float
    pose: Pose2D
    covariance: Array


def smooth(
    sights: Sequence[Sight], walks: Walks, speed_std: float = 1.0, rate_std: float = 0.5
) -> Array:
    """Return the smoothed states (n, 5) of `turn_rate` at the times of `sights`.

    Rauch, Tung, Striebel: Maximum likelihood estimates of linear dynamic systems, AIAA
    Journal 3 (1965), on an extended Kalman filter.

    Args:
        sights: The observations, n >= 1.
        walks: What disturbs the motion, see `turn_rate.process_noise`.
        speed_std: Uncertainty of the speed at the first observation [m/s].
        rate_std: That of the turn rate [rad/s].
    """
    x = np.array([*sights[0].pose, 0.0, 0.0])
    P = np.zeros((SIZE, SIZE))
    P[:SEEN, :SEEN] = sights[0].covariance
    P[range(SEEN, SIZE), range(SEEN, SIZE)] = speed_std**2, rate_std**2
    filtered, predicted = [(x, P)], []
    for last, sight in pairwise(sights):
        dt = sight.time - last.time
        F = jacobian(x, dt)
        P = F @ P @ F.T + process_noise(walks, x, dt)
        x = move(x, dt)
        predicted.append((x, P, F))
        K = P[:, :SEEN] @ np.linalg.inv(P[:SEEN, :SEEN] + sight.covariance)
        x = x + K @ (unwrap_yaw(float(x[YAW]), sight.pose) - x[:SEEN])
        P = P - K @ P[:SEEN]
        P = (P + P.T) / 2.0
        filtered.append((x, P))
    smoothed = [filtered[-1][0]]
    for (x, P), (ahead, P_ahead, F) in zip(
        reversed(filtered[:-1]), reversed(predicted), strict=True
    ):
        G = np.linalg.solve(P_ahead, F @ P).T
        smoothed.append(x + G @ (smoothed[-1] - ahead))
    return np.array(smoothed[::-1])


LEVELS = tuple(
    (0.02, 0.001, 0.0, speed, rate)
    for speed in (0.01, 0.1, 1.0)
    for rate in (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
)
"""Disturbances from which the best is taken in hindsight: a bound may know which."""


def least_errors(sights: Sequence[Sight], truth: Poses) -> tuple[float, float]:
    """Return the mean errors of the best smoother: position [m], yaw [deg].

    `truth` are the true poses at the times of `sights`. Each error is of the level of
    disturbance that is the best for it.
    """
    errors = []
    for walks in LEVELS:
        states = smooth(sights, walks)
        position = np.hypot(states[:, X] - truth.x, states[:, Y] - truth.y).mean()
        yaw = np.abs(wrap(states[:, YAW] - truth.yaw)).mean()
        errors.append((float(position), math.degrees(yaw)))
    positions, yaws = zip(*errors, strict=True)
    return min(positions), min(yaws)
