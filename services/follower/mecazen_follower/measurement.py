"""Measurements of persons in odom, and their check."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from mecazen.errors import RefusedError
from mecazen.geometry import Pose2D
from mecazen.messages import FARTHEST, PlanarCovariance

from mecazen_follower.estimators.base import MIN_NOISE

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
        RefusedError: The pose is beyond `FARTHEST`, or the covariance is not
            finite, symmetric and positive semidefinite.
    """
    pose, covariance, _ = measurement
    if not all(abs(number) <= FARTHEST for number in pose):
        raise RefusedError(f"observation is out of range: {tuple(pose)}")
    if not all(abs(number) <= FARTHEST**2 for row in covariance for number in row):
        raise RefusedError("covariance of an observation must be finite")
    (xx, xy, xw), (yx, yy, yw), (wx, wy, ww) = covariance
    symmetric = all(
        math.isclose(upper, lower, rel_tol=1e-5, abs_tol=1e-8)  # to single precision
        for upper, lower in ((xy, yx), (xw, wx), (yw, wy))
    )
    least, kept = float(MIN_NOISE[0, 0]), 1.0 - MARGIN
    variances = xx * kept + least, yy * kept + least, ww * kept + least
    if not (symmetric and _is_positive(*variances, yx, wx, wy)):
        raise RefusedError("covariance of an observation must be symmetric and positive")
    return measurement


def _is_positive(xx: float, yy: float, ww: float, yx: float, wx: float, wy: float) -> bool:
    """Return whether a symmetric matrix is positive definite, by Gaussian elimination."""
    if xx <= 0.0:
        return False
    yy -= yx / xx * yx
    wy -= wx / xx * yx
    ww -= wx / xx * wx
    return yy > 0.0 and ww - wy / yy * wy > 0.0


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
