"""Covariances of planar poses: their ellipses, and errors measured by them."""

from __future__ import annotations

import math

import numpy as np
from mecazen.geometry import Pose2D, wrap
from mecazen.messages import planar_covariance
from mecazen.portable import Floats

SCALE = math.sqrt(-2.0 * math.log(0.05))
"""Scale of the 95 % ellipse: the chi-square quantile of two degrees of freedom is -2·ln(1 - p)."""
SMALLEST, LARGEST = 1e-12, 1e6
"""Bounds of the eigenvalues [m², rad²] that can be drawn."""
FLATTEST = 1e-14
"""Least ratio of the eigenvalues: below it, rounding can make a covariance singular."""


def planar(covariance: tuple[float, ...]) -> Floats | None:
    """Return the covariance (3, 3) of (x, y, yaw) from ROS's 6x6; None if not positive definite."""
    rows = np.array(planar_covariance(covariance))
    part: Floats = (rows + rows.T) / 2.0
    eigenvalues = np.linalg.eigvalsh(part)
    if np.abs(part).max() > LARGEST or eigenvalues[0] < max(SMALLEST, FLATTEST * eigenvalues[-1]):
        return None
    return part


def ellipse_axes(covariance: Floats, yaw: float = 0.0) -> Floats:
    """Return two conjugate half diameters (2, 2) [m], as columns, of the 95 % position ellipse.

    `covariance` (3, 3) over (x, y, yaw) is rotated by `yaw` [rad].
    """
    # any L with L·Lᵀ = C maps the unit circle to the same ellipse; here L is the Cholesky factor
    xx, xy, yy = float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])
    a = math.sqrt(xx)
    b = xy / a
    d = math.sqrt(yy - b * b)
    c, s = SCALE * math.cos(yaw), SCALE * math.sin(yaw)
    return np.array([[c * a - s * b, -s * d], [s * a + c * b, c * d]])


def nees(estimate: Pose2D, truth: Pose2D, covariance: Floats) -> float:
    """Return the normalised estimation error squared, eᵀ·P⁻¹·e over (x, y, yaw).

    A consistent filter has a mean of 3 and 95 % below 7.815 (Y. Bar-Shalom,
    X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and Navigation, 5.4).
    """
    error = np.array([estimate.x - truth.x, estimate.y - truth.y, wrap(estimate.yaw - truth.yaw)])
    return float(error @ np.linalg.solve(covariance, error))
