"""The driver of a robot: the link to its board, its wheels, and when its motors are stopped.

The nodes `hardware` and `motors` of a process share one driver. In each tick, `hardware` runs
before all other nodes and turns reports into the state; `motors` runs after them and turns commands
into frames.
"""

from __future__ import annotations

import logging
import math
import time
from typing import TypeVar

from mecazen.config import Scenario
from mecazen.robot import RealMotors
from mecazen.wheels import WheelSpeeds

from mecazen_hardware.board import Identity, Inertial, Report, Voltage, WheelAngles
from mecazen_hardware.link import HardwareError, Link
from mecazen_hardware.wheels import WheelEstimator

logger = logging.getLogger(__name__)

REPORT_TIMEOUT_S = 0.25
"""Time without a report of the wheels after which the motors are stopped [s]."""
GIVE_UP_S = 1.0
"""Silence of the board after which the driver exits [s]; the motors are stopped long before."""
STOP_AFTER_S = 0.4
"""Age of a wheel command beyond which the motors are stopped instead of braked [s]."""
LOW_FOR_S = 1.0
"""Time for which the voltage has to be low [s]: starting motors lower it for a moment. The board of
the X3 switches itself off after 2 s."""
STILL_RAD_S = 0.05
"""Speed below which a wheel is commanded to stand; compensating the dead band would cause
chatter."""
NO_COMMAND = "no command"
STILL = WheelSpeeds()
MeasuredT = TypeVar("MeasuredT", Inertial, Voltage)


class Driver:
    """Drives one robot.

    All methods but `diagnostics` and `close` raise HardwareError once the port has gone, and the
    constructor if the board does not answer as it should.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.config = scenario.hardware
        self.link = Link(self.config, scenario.robot)
        cycle_s = self.link.board.CYCLE_S
        self.wheels = WheelEstimator(cycle_s, scenario.robot.wheels.max_speed_rad_s)
        self._motors = scenario.robot.motors
        self.is_engaged = False
        """Whether the emergency stop is engaged."""
        self.volts = math.nan
        """The newest voltage of the battery [V]."""
        self._low_since_s = math.inf
        self._empty_volts = math.nan
        """The voltage that stopped the motors [V]; NaN if the battery was never low for long."""
        self.stopped_for = ""
        """Reason for which the motors are stopped; empty if they may run."""
        self._new: dict[type[Report], Report] = {}
        self._now_s = time.monotonic()
        logger.info("msg=%r", f"{self.config.port}: {self.link.identity.name}")

    def begin(self) -> None:
        """Begin a run: stop the motors, and set the angles of the wheels to zero."""
        self.link.stop()
        self.wheels.reset()

    def measure(self, dt: float) -> tuple[tuple[float, ...], WheelSpeeds]:
        """Return the wheels' angles [rad] and speeds [rad/s] now, `dt` after the last call [s].

        Raises:
            HardwareError: The board has been silent for too long.
        """
        self._now_s = time.monotonic()
        for report, arrived_s in self.link.read():
            if isinstance(report, WheelAngles):
                self.wheels.take(report, arrived_s)
            elif isinstance(report, Voltage):
                self._watch_battery(report.volts, arrived_s)
            elif isinstance(report, Identity) and report.problem:
                raise HardwareError(f"{self.config.port}: {report.name}: {report.problem}")
            self._new[type(report)] = report
        if GIVE_UP_S < self.report_age_s < math.inf:
            raise HardwareError(
                f"{self.config.port}: the board has been silent for {self.report_age_s:.1f} s: is "
                "its cable loose, or has it switched itself off on a low battery? If the robot "
                "still drives, switch it off"
            )
        return self.wheels.advance(self._now_s, dt)

    @property
    def report_age_s(self) -> float:
        """Age of the newest report of the wheels [s]."""
        return self._now_s - self.wheels.reported_s

    def take(self, kind: type[MeasuredT]) -> MeasuredT | None:
        """Return a new report of a kind, once."""
        return self._new.pop(kind, None)  # type: ignore[return-value]  # by its key

    def drive(self, speeds: WheelSpeeds, command_age_s: float) -> None:
        """Send wheel speeds [rad/s], or stop the motors if they may not run."""
        reason = self._reason(command_age_s)
        has_to_stop = bool(reason) and not self.stopped_for
        if reason not in (self.stopped_for, NO_COMMAND, ""):
            logger.warning("msg=%r", f"motors stopped: {reason}")
        self.stopped_for = reason
        if has_to_stop:
            self.link.stop()
            return
        try:
            self.link.drive(STILL if reason else compensated(speeds, self._motors))
        except ValueError:  # not finite
            self.link.stop()

    def _watch_battery(self, volts: float, now_s: float) -> None:
        self.volts = volts
        is_low = volts < self.config.min_voltage_v
        self._low_since_s = min(self._low_since_s, now_s) if is_low else math.inf
        if math.isnan(self._empty_volts) and now_s - self._low_since_s >= LOW_FOR_S:
            self._empty_volts = volts

    def _reason(self, command_age_s: float) -> str:
        """Return the reason to stop the motors; empty if they may run."""
        if self.is_engaged:
            return "emergency stop; emergency_stop/release lets it drive again"
        if not math.isnan(self._empty_volts):
            least = self.config.min_voltage_v
            return f"battery was at {self._empty_volts:.1f} V; {least:g} V is the least"
        if self.report_age_s > REPORT_TIMEOUT_S:
            return "no report of the board"
        return NO_COMMAND if command_age_s > STOP_AFTER_S else ""

    def engage(self, *, is_engaged: bool) -> None:
        """Engage or release the emergency stop."""
        self.is_engaged = is_engaged
        if is_engaged:
            self.drive(STILL, 0.0)

    def diagnostics(self) -> dict[str, object]:
        """Return the state of the link and of the board."""
        board, age_s = self.link.board, self.report_age_s
        return {
            "board": self.link.identity.name,
            "battery_v": "unknown" if math.isnan(self.volts) else self.volts,
            "report_age_s": "never" if math.isinf(age_s) else round(age_s, 3),
            "frames_sent": self.link.sent,
            "frames_unsent": self.link.unsent,
            "frames_received": board.frames,
            "damaged": board.refused,
            "jumps": self.wheels.jumps,
            **({"warning/motors": f"stopped: {self.stopped_for}"} if self.stopped_for else {}),
        }

    def close(self) -> None:
        """Stop the motors, and close the port."""
        self.link.close()


def compensated(speeds: WheelSpeeds, motors: RealMotors | None) -> WheelSpeeds:
    """Return the speeds to command so that the wheels turn at `speeds` [rad/s].

    A motor turns at its gain times the command less the dead band: this is the inverse.
    """
    if motors is None:
        return speeds
    return WheelSpeeds(
        *(
            speed / gain + math.copysign(motors.dead_band_rad_s, speed)
            if abs(speed) > STILL_RAD_S
            else 0.0
            for speed, gain in zip(speeds, motors.gains, strict=True)
        )
    )
