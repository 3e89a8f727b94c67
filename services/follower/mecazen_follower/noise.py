"""Detects a sensor that is noisier than it reports."""

from __future__ import annotations

import math

from mecazen.geometry import Pose2D, wrap
from mecazen.messages import PlanarCovariance

MEMORY_S = 5.0
"""Time constant of the mean [s]."""
LONGEST_FRAME_S = 0.1
"""Longest frame period [s]: over a longer period the person's acceleration exceeds the noise."""
DOUBTED, MAX_RATIO = 1.5, 9.0
"""Ratios of variances: a ratio below `DOUBTED` may be chance; `MAX_RATIO` is the upper bound."""


class ReportedNoise:
    """The sensor's actual variances relative to those that it reports, of position and yaw.

    The second difference of three frames z, z' - 2 z + z'', contains almost none of the person's
    motion and has six times the variance of white noise. No model of motion is needed, so a
    manoeuvre is not taken for noise. A sensor that is better than it reports does no harm.
    """

    def __init__(self) -> None:
        self._ratios = 1.0, 1.0
        self._last: tuple[float, Pose2D] | None = None
        self._step: tuple[float, Pose2D] | None = None
        """The last period [s], and the difference of the poses over it."""

    def learn(self, time: float, pose: Pose2D, covariance: PlanarCovariance) -> None:
        """Learn from a measurement captured at `time` [s], with its `corrected` covariance."""
        last, before = self._last, self._step
        self._last, self._step = (time, pose), None
        if last is None or time - last[0] > LONGEST_FRAME_S:
            return
        dt, (x, y, yaw) = time - last[0], last[1]
        self._step = dt, Pose2D(pose.x - x, pose.y - y, wrap(pose.yaw - yaw))
        if before is None or not math.isclose(before[0], dt, rel_tol=0.01):
            return
        xx, yy, ww = ((b - a) ** 2 / 6.0 for a, b in zip(before[1], self._step[1], strict=True))
        (rxx, _, _), (_, ryy, _), (_, _, rww) = covariance
        weight = -math.expm1(-dt / MEMORY_S)
        found = (xx + yy) / (rxx + ryy), ww / rww
        position, heading = (
            min(old + weight * (applied * new - old), MAX_RATIO)
            for old, applied, new in zip(self._ratios, self._applied, found, strict=True)
        )
        self._ratios = position, heading

    @property
    def _applied(self) -> tuple[float, float]:
        position, heading = (ratio if ratio > DOUBTED else 1.0 for ratio in self._ratios)
        return position, heading

    def corrected(self, covariance: PlanarCovariance) -> PlanarCovariance:
        """Return a reported covariance, scaled up if the sensor is noisier than it reports."""
        position, heading = self._applied
        if position == heading == 1.0:
            return covariance
        both = math.sqrt(position * heading)
        (xx, xy, xw), (yx, yy, yw), (wx, wy, ww) = covariance
        return (
            (xx * position, xy * position, xw * both),
            (yx * position, yy * position, yw * both),
            (wx * both, wy * both, ww * heading),
        )
