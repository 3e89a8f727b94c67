"""Measurements of persons in odom, and their check."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D
from mecazen.messages import FARTHEST, PlanarCovariance

from mecazen_follower.estimators.base import MIN_NOISE, Array

NO_HEADING = 100.0
"""Minimum variance of a heading that is not observed [rad²]."""
MARGIN = 1e-13
"""Margin by which a covariance must exceed semidefinite, as a share of its variances: scaling and
adding covariances rounds each number by a relative 1e-16."""


class Measurement(NamedTuple):
    """An observed pose of a person in odom, and its 3x3 covariance of (x, y, yaw)."""

    pose: Pose2D
    covariance: PlanarCovariance
    identity: str = ""
    """The sensor's id of the person; empty if there is none."""

    def has_id(self, identity: str) -> bool:
        """Return whether the sensor gave this id; no id is equal to an empty one."""
        return identity != "" and self.identity == identity

    @property
    def has_heading(self) -> bool:
        """Whether the sensor observed the heading."""
        return self.covariance[2][2] < NO_HEADING


class Frame(NamedTuple):
    """A frame of the sensor: its time of capture [s], and all persons in it."""

    captured: float
    measurements: Sequence[Measurement]
    begins: bool = True
    """Whether the frame may start the person's track, and not only continue it."""


def check(measurement: Measurement) -> Measurement:
    """Return a measurement that every estimator can use.

    Raises:
        RefusedError: The pose is not finite or farther than 1000 km, or the covariance is not
            finite, symmetric and positive semidefinite.
    """
    pose, covariance, _ = measurement
    if not all(abs(number) <= FARTHEST for number in pose):
        raise RefusedError(f"observation is out of range: {tuple(pose)}")
    matrix = np.array(covariance)
    if not np.all(np.abs(matrix) <= FARTHEST**2):
        raise RefusedError("covariance of an observation must be finite")
    is_symmetric = np.allclose(matrix, matrix.T, rtol=1e-5)  # to single precision
    lowered = matrix - MARGIN * np.diag(np.diag(matrix))
    if not (is_symmetric and _is_positive(lowered + MIN_NOISE)):
        raise RefusedError("covariance of an observation must be symmetric and positive")
    return measurement


def _is_positive(matrix: Array) -> bool:
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


def rotated(covariance: PlanarCovariance, yaw: float) -> PlanarCovariance:
    """Return a 3x3 covariance C of (x, y, yaw) as R C Rᵀ, R the rotation by `yaw` [rad]."""
    (xx, xy, xw), (yx, yy, yw), (wx, wy, ww) = covariance
    c, s = math.cos(yaw), math.sin(yaw)
    # first R C over x and y, then the product
    cxx, cxy, cyx, cyy = c * xx - s * yx, c * xy - s * yy, s * xx + c * yx, s * xy + c * yy
    return (
        (c * cxx - s * cxy, s * cxx + c * cxy, c * xw - s * yw),
        (c * cyx - s * cyy, s * cyx + c * cyy, s * xw + c * yw),
        (c * wx - s * wy, s * wx + c * wy, ww),
    )
