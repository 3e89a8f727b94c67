"""Angles and speeds of the wheels at each tick, interpolated between the reports of a board.

A board reports at a low rate, and its reports arrive with the jitter of USB and the host. So the
interval between two reports is rounded to whole cycles of the board, and between reports the angles
continue at the last measured speed. The correction by a report is spread over a cycle, so the
speeds have no spikes. The integral of the speeds follows the encoders, so odometry does not drift.
"""

from __future__ import annotations

import math

from mecazen.wheels import PLAUSIBLE_SPEED, WheelSpeeds

from mecazen_hardware.board import WheelAngles

BELIEVED_AFTER = 2
"""Number of reports in a row after which a wheel continues from the angle to which it jumped."""
MOST_CYCLES = 100
"""Maximum number of cycles of an interval between two reports."""
AHEAD_CYCLES = 2.0
"""Number of cycles for which the last speed is used without a new report."""


class WheelEstimator:
    """Estimates the wheels' angles and speeds at any time from reports.

    Reports come every `cycle_s` [s], and no wheel is faster than `max_speed` [rad/s].
    """

    def __init__(self, cycle_s: float, max_speed: float) -> None:
        self._cycle_s = cycle_s
        self._max_speed = max_speed
        self.jumps = 0
        """Number of reports that no motion can explain."""
        self._doubted = 0
        self._last: WheelAngles | None = None
        self.reported_s = -math.inf
        """Arrival of the newest report [s]."""
        self._measured: tuple[float, ...] = (0.0,) * 4
        """Speeds between the last two reports [rad/s]."""
        self._turned: tuple[float, ...] = (0.0,) * 4
        """Sum of the changes in the reports [rad]."""
        self.angles: tuple[float, ...] = (0.0,) * 4
        """The angles that `advance` returned last: the integral of its speeds [rad]."""

    def take(self, report: WheelAngles, now_s: float) -> None:
        """Update with a report that arrived at `now_s` [s]."""
        elapsed_s = now_s - self.reported_s
        interval_s = self._cycle_s * max(1, round(min(elapsed_s / self._cycle_s, MOST_CYCLES)))
        pairs = zip(report.angles, (self._last or report).angles, strict=True)
        change = tuple(math.remainder(new - old, report.span) for new, old in pairs)
        most = PLAUSIBLE_SPEED * self._max_speed * interval_s
        if max(map(abs, change)) > most:
            self.jumps += 1
            self._doubted += 1
            if self._doubted < BELIEVED_AFTER:
                return  # a single damaged number: the next report contains the missed change
            change = tuple(
                angle if abs(angle) <= most else speed * interval_s
                for angle, speed in zip(change, self._measured, strict=True)
            )
        self._doubted = 0
        self._last = report
        self.reported_s = now_s
        self._measured = tuple(angle / interval_s for angle in change)
        self._turned = tuple(map(sum, zip(self._turned, change, strict=True)))

    def advance(self, now_s: float, dt: float) -> tuple[tuple[float, ...], WheelSpeeds]:
        """Return angles [rad] and speeds [rad/s] at `now_s`, `dt` after the last call [s]."""
        limit_s = AHEAD_CYCLES * self._cycle_s
        ahead_s = min(max(now_s - self.reported_s, 0.0), limit_s)
        correction_s = max(self._cycle_s, dt)
        angles, speeds = [], []
        for turned, measured, angle in zip(self._turned, self._measured, self.angles, strict=True):
            speed = measured if ahead_s < limit_s else 0.0
            error = turned + measured * ahead_s - (angle + speed * dt)
            speeds.append(speed + error / correction_s)
            angles.append(angle + speeds[-1] * dt)
        self.angles = tuple(angles)
        return self.angles, WheelSpeeds(*speeds)

    def reset(self) -> None:
        """Set the angles to zero."""
        self._turned = self.angles = (0.0,) * 4
