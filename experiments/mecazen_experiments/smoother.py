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
from mecazen_follower.estimators import turn_rate as ctrv

from mecazen_experiments.table import Floats, Poses, wrap


class Sight(NamedTuple):
    """An observed pose, its covariance (3, 3), and its time [s], after the previous one."""

    time: float
    pose: Pose2D
    covariance: Floats


def smooth(
    sights: Sequence[Sight], walks: ctrv.Walks, speed_std: float = 1.0, rate_std: float = 0.5
) -> Floats:
    """Return the smoothed states (n, 5) of `turn_rate` at the times of `sights`, n >= 1.

    Rauch, Tung, Striebel: Maximum likelihood estimates of linear dynamic systems, AIAA
    Journal 3 (1965), on an extended Kalman filter. `speed_std` [m/s] and `rate_std` [rad/s] are the
    deviations of the first state.
    """
    x = np.array([*sights[0].pose, 0.0, 0.0])
    P = np.zeros((ctrv.SIZE, ctrv.SIZE))
    P[: ctrv.SEEN, : ctrv.SEEN] = sights[0].covariance
    P[range(ctrv.SEEN, ctrv.SIZE), range(ctrv.SEEN, ctrv.SIZE)] = speed_std**2, rate_std**2
    filtered, predicted = [(x, P)], []
    for last, sight in pairwise(sights):
        dt = sight.time - last.time
        F = ctrv.jacobian(x, dt)
        P = F @ P @ F.T + ctrv.process_noise(walks, x, dt)
        x = ctrv.move(x, dt)
        predicted.append((x, P, F))
        K = P[:, : ctrv.SEEN] @ np.linalg.inv(P[: ctrv.SEEN, : ctrv.SEEN] + sight.covariance)
        x = x + K @ (ctrv.unwrap_yaw(float(x[ctrv.YAW]), sight.pose) - x[: ctrv.SEEN])
        P = P - K @ P[: ctrv.SEEN]
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
        position = np.hypot(states[:, ctrv.X] - truth.x, states[:, ctrv.Y] - truth.y).mean()
        yaw = np.abs(wrap(states[:, ctrv.YAW] - truth.yaw)).mean()
        errors.append((float(position), math.degrees(yaw)))
    positions, yaws = zip(*errors, strict=True)
    return min(positions), min(yaws)
