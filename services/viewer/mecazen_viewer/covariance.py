"""Covariances of planar poses: their ellipses, and errors measured by them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from mecazen.geometry import Pose2D, wrap

Array = npt.NDArray[np.float64]

PLANAR = np.ix_((0, 1, 5), (0, 1, 5))
"""Rows and columns of x, y and yaw in ROS's 6x6."""
SCALE = math.sqrt(-2.0 * math.log(0.05))
"""Of the ellipse that holds 95 %: the chi-square quantile of two freedoms is -2·ln(1 - p)."""
SMALLEST, LARGEST = 1e-12, 1e6
"""Beyond them [m², rad²] it says nothing that could be drawn."""


def planar(covariance: tuple[float, ...]) -> Array | None:
    """Return the (3, 3) part over (x, y, yaw) of a row-major 6x6, or None where it is none."""
    part = np.reshape(covariance, (6, 6))[PLANAR]
    if np.abs(part).max() > LARGEST or np.linalg.eigvalsh(part).min() < SMALLEST:
        return None
    return part


def ellipse_axes(covariance: Array, yaw: float = 0.0) -> Array:
    """Return two half diameters (2, 2) [m], as columns, of the ellipse with 95 % of the positions.

    `covariance` (3, 3) over (x, y, yaw) is turned by `yaw` [rad].
    """
    # Cholesky's factor: any L with L·Lᵀ = C makes the same ellipse of the unit circle
    xx, xy, yy = float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])
    a = math.sqrt(xx)
    b = xy / a
    d = math.sqrt(yy - b * b)
    c, s = SCALE * math.cos(yaw), SCALE * math.sin(yaw)
    return np.array([[c * a - s * b, -s * d], [s * a + c * b, c * d]])


def nees(estimate: Pose2D, truth: Pose2D, covariance: Array) -> float:
    """Return the normalised estimation error squared, eᵀ·P⁻¹·e over (x, y, yaw).

    Of a filter that knows its errors its mean is 3, and 95 % lie below 7.815 (Y. Bar-Shalom,
    X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 5.4).
    """
    error = np.array([estimate.x - truth.x, estimate.y - truth.y, wrap(estimate.yaw - truth.yaw)])
    return float(error @ np.linalg.solve(covariance, error))
