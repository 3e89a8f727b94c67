"""Drift of odometry from the reference over a time."""

from __future__ import annotations

import numpy as np

from mecazen_experiments.identify.runs import Array, Run
from mecazen_experiments.identify.windows import motions


def odometry(run: Run, coefficients: Array) -> Array:
    """Return the poses of the reference (n, 3) that a model predicts from the wheels' angles.

    Args:
        run: The run.
        coefficients: J, in the reference's frame, and the reference's offset (14,).
    """
    steps = np.diff(run.wheels, axis=0) @ coefficients[:12].reshape(3, 4).T
    return shifted(integrated(steps), coefficients[12:])


def integrated(steps: Array) -> Array:
    """Return the poses (n + 1, 3) after steps in the robot's frame (n, 3), starting at 0."""
    yaw = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    middle = (yaw[1:] + yaw[:-1]) / 2.0
    c, s = np.cos(middle), np.sin(middle)
    x = np.concatenate([[0.0], np.cumsum(c * steps[:, 0] - s * steps[:, 1])])
    y = np.concatenate([[0.0], np.cumsum(s * steps[:, 0] + c * steps[:, 1])])
    return np.stack([x, y, yaw], axis=1)


def shifted(poses: Array, offset: Array) -> Array:
    """Return the poses of a point with an offset [m] in the frame of the given poses (n, 3)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, 0] + c * offset[0] - s * offset[1]
    y = poses[:, 1] + s * offset[0] + c * offset[1]
    return np.stack([x, y, poses[:, 2]], axis=1)


def drifts(run: Run, poses: Array, horizon_s: float) -> Array:
    """Return the drift of `poses` in consecutive spans of the run: [m] and [rad] (m, 2).

    In each span, `poses` begin at the reference's pose. Spans with a gap are left out.
    """
    size = max(1, round(horizon_s / run.period_s))
    first = run.starts(size)
    error = motions(run.poses, first, size) - motions(poses, first, size)
    yaw = np.abs(np.remainder(error[:, 2] + np.pi, 2.0 * np.pi) - np.pi)
    return np.stack([np.hypot(error[:, 0], error[:, 1]), yaw], axis=1)
