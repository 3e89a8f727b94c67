"""A smoother of the person's state, from all observations.

The smoother also uses observations after an instant, so it bounds the accuracy of any filter with
this model.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from mecazen.geometry import Pose2D
from mecazen_follower.estimators.imm import OBSERVED, SIZE, YAW, V, X, Y, ctrv, process_noise
from mecazen_tools.table import Floats, Poses, wrap


class Sight(NamedTuple):
    """An observed pose, its covariance (3, 3), and its time [s], after the previous one."""

    time: float
    pose: Pose2D
    covariance: Floats


def smooth(
    sights: Sequence[Sight], walks: Sequence[float], speed_std: float = 1.0, rate_std: float = 0.5
) -> Floats:
    """Return the smoothed states (n, 5) of `estimators.imm` at the times of `sights`, n >= 1.

    Rauch, Tung, Striebel: Maximum likelihood estimates of linear dynamic systems, AIAA
    Journal 3 (1965), on an extended Kalman filter. `speed_std` [m/s] and `rate_std` [rad/s] are the
    deviations of the first state.
    """
    variances = np.square(walks).tolist()
    x = np.array([*sights[0].pose, 0.0, 0.0])
    P = np.zeros((SIZE, SIZE))
    P[:OBSERVED, :OBSERVED] = sights[0].covariance
    P[V:, V:] = np.diag([speed_std**2, rate_std**2])
    filtered, predicted = [(x, P)], []
    for last, sight in pairwise(sights):
        dt = sight.time - last.time
        Q = process_noise(variances, x, dt)
        x, F = ctrv(x, dt)
        P = F @ P @ F.T + Q
        predicted.append((x, P, F))
        K = P[:, :OBSERVED] @ np.linalg.inv(P[:OBSERVED, :OBSERVED] + sight.covariance)
        innovation = np.array(sight.pose) - x[:OBSERVED]
        innovation[YAW] = math.remainder(innovation[YAW], math.tau)
        x = x + K @ innovation
        P = P - K @ P[:OBSERVED]
        P = (P + P.T) / 2.0
        filtered.append((x, P))
    smoothed = [filtered[-1][0]]
    for (x, P), (ahead, P_ahead, F) in zip(filtered[-2::-1], predicted[::-1], strict=True):
        G = np.linalg.solve(P_ahead, F @ P).T
        smoothed.append(x + G @ (smoothed[-1] - ahead))
    return np.array(smoothed[::-1])


LEVELS = tuple(
    (0.02, 0.001, 0.0, speed, rate)
    for speed in (0.01, 0.1, 1.0)
    for rate in (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
)
"""Levels of disturbance; the best is chosen in hindsight, which is valid for a bound."""


def least_errors(sights: Sequence[Sight], truth: Poses) -> tuple[float, float]:
    """Return the mean errors of the best smoother: position [m], yaw [deg].

    `truth` are the true poses at the times of `sights`. Each error is that at its own best level of
    disturbance.
    """
    errors = []
    for walks in LEVELS:
        states = smooth(sights, walks)
        position = np.hypot(states[:, X] - truth.x, states[:, Y] - truth.y).mean()
        yaw = np.abs(wrap(states[:, YAW] - truth.yaw)).mean()
        errors.append((float(position), math.degrees(yaw)))
    positions, yaws = zip(*errors, strict=True)
    return min(positions), min(yaws)
