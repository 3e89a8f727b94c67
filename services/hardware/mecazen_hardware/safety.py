"""Decides whether motors may run, and the reason to stop them, without port and clock."""

from __future__ import annotations

import math

from mecazen.config import HardwareConfig

REPORT_TIMEOUT_S = 0.25
"""Time without a report of the wheels after which the motors are stopped [s]."""
LOW_FOR_S = 1.0
"""Time for which the voltage has to be low [s]: starting motors lower it for a moment. The board of
the X3 switches itself off after 2 s."""
STOP_AFTER_S = 0.4
"""Age of a wheel command beyond which the motors are stopped instead of braked [s]."""
NO_COMMAND = "no command"


class Safety:
    """Decides whether motors may run.

    Args:
        config: The limits.
    """

    def __init__(self, config: HardwareConfig) -> None:
        self._config = config
        self.is_engaged = False
        """Whether the emergency stop is engaged."""
        self.volts = math.nan
        """The newest voltage [V]."""
        self._low_since_s = math.inf
        self._empty_volts = math.nan
        """The voltage that stopped the motors [V]; NaN if the battery was never low for long."""

    def measured(self, volts: float, now_s: float) -> None:
        """Update with the voltage of the battery [V] at `now_s` [s]."""
        self.volts = volts
        if volts >= self._config.min_voltage_v:
            self._low_since_s = math.inf
        else:
            self._low_since_s = min(self._low_since_s, now_s)
        if math.isnan(self._empty_volts) and now_s - self._low_since_s >= LOW_FOR_S:
            self._empty_volts = volts

    def reason(self, command_age_s: float, report_age_s: float) -> str:
        """Return the reason to stop the motors; empty if they may run.

        Args:
            command_age_s: Age of the newest wheel command [s].
            report_age_s: Age of the newest report of the wheels [s].
        """
        if self.is_engaged:
            return "emergency stop; emergency_stop/release lets it drive again"
        if not math.isnan(self._empty_volts):
            least = self._config.min_voltage_v
            return f"battery was at {self._empty_volts:.1f} V; {least:g} V is the least"
        if report_age_s > REPORT_TIMEOUT_S:
            return "no report of the board"
        if command_age_s > STOP_AFTER_S:
            return NO_COMMAND
        return ""
