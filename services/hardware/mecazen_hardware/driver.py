"""The driver of a robot: the link to its board, its wheels, and their safety stops.

The nodes `hardware` and `motors` of a process share one driver. In each tick, `hardware` runs
before all other nodes and turns reports into the state; `motors` runs after them and turns commands
into frames.
"""

from __future__ import annotations

import logging
import math
import time

from mecazen.config import HardwareConfig, Scenario
from mecazen.wheels import WheelSpeeds

from mecazen_hardware.board import Identity, Inertial, MeasuredSpeeds, Report, Voltage, WheelAngles
from mecazen_hardware.boards import open_link
from mecazen_hardware.compensation import compensated
from mecazen_hardware.errors import HardwareError
from mecazen_hardware.safety import NO_COMMAND, Safety
from mecazen_hardware.wheels import Four, Wheels

logger = logging.getLogger(__name__)

GIVE_UP_S = 1.0
"""Silence of the board after which the driver exits [s]; the motors are stopped long before."""
STILL = WheelSpeeds()


class Driver:
    """Drives one robot.

    Args:
        scenario: Names board, port and robot.

    Raises:
        HardwareError: The port can't be opened, or the board does not answer as it should.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.config: HardwareConfig = scenario.hardware
        self.link = open_link(self.config, scenario.robot)
        board = self.link.board
        self.wheels = Wheels(board.CYCLE_S, scenario.robot.wheels.max_speed_rad_s)
        self.safety = Safety(self.config)
        self._motors = scenario.robot.motors
        self.stopped_for = ""
        """Reason for which the motors are stopped; empty if they may run."""
        self.refused_commands = 0
        """Number of commands that were not finite."""
        self._fresh: dict[type[Report], Report] = {}
        self._asked_s = self._now_s = time.monotonic()
        logger.info("msg=%r", f"{self.config.port}: {self.link.identity.name}")

    def begin(self) -> None:
        """Begin a run: stop the motors, and set the angles of the wheels to zero.

        Raises:
            HardwareError: The port has gone.
        """
        self.link.stop()
        self.wheels.reset()

    def measure(self, dt: float) -> tuple[Four, WheelSpeeds]:
        """Return the wheels' angles [rad] and speeds [rad/s] now, `dt` after the last call [s].

        Raises:
            HardwareError: The port has gone, or the board has been silent for too long.
        """
        self._now_s = now_s = time.monotonic()
        for report, arrived_s in self.link.read():
            if isinstance(report, WheelAngles | MeasuredSpeeds):
                self.wheels.take(report, arrived_s)
            elif isinstance(report, Identity) and report.problem:
                raise HardwareError(f"{self.config.port}: {report.name}: {report.problem}")
            if isinstance(report, Voltage):
                self.safety.measured(report.volts, arrived_s)
            self._fresh[type(report)] = report
        if now_s - self._asked_s >= self.link.board.CYCLE_S:
            self._asked_s = now_s
            self.link.poll()
        silent_s = self.report_age_s
        if GIVE_UP_S < silent_s < math.inf:
            raise HardwareError(
                f"{self.config.port}: the board has been silent for {silent_s:.1f} s: is its cable "
                "loose, or has it switched itself off on a low battery? If the robot still drives, "
                "switch it off"
            )
        return self.wheels.advance(now_s, dt)

    @property
    def report_age_s(self) -> float:
        """Age of the newest report of the wheels [s]."""
        return self._now_s - self.wheels.reported_s

    def inertial(self) -> Inertial | None:
        """Return a new report of the inertial sensors, once."""
        return self._fresh.pop(Inertial, None)  # type: ignore[return-value]  # by its key

    def voltage(self) -> Voltage | None:
        """Return a new report of the battery, once."""
        return self._fresh.pop(Voltage, None)  # type: ignore[return-value]  # by its key

    def drive(self, speeds: WheelSpeeds, command_age_s: float) -> None:
        """Send wheel speeds [rad/s], or stop the motors if they may not run.

        Raises:
            HardwareError: The port has gone.
        """
        reason = self.safety.reason(command_age_s, self.report_age_s)
        has_to_stop = bool(reason) and not self.stopped_for
        if reason not in (self.stopped_for, NO_COMMAND, ""):
            logger.warning("msg=%r", f"motors stopped: {reason}")
        self.stopped_for = reason
        if has_to_stop:
            self.link.stop()
            return
        try:
            self.link.drive(STILL if reason else compensated(speeds, self._motors))
        except ValueError:
            self.refused_commands += 1
            self.link.stop()

    def engage(self, *, is_engaged: bool) -> None:
        """Engage or release the emergency stop.

        Raises:
            HardwareError: The port has gone.
        """
        self.safety.is_engaged = is_engaged
        if is_engaged:
            self.drive(STILL, 0.0)

    def diagnostics(self) -> dict[str, object]:
        """Return the state of the link and of the board."""
        board = self.link.board
        age_s = self.report_age_s
        return {
            "board": self.link.identity.name,
            "battery_v": "unknown" if math.isnan(self.safety.volts) else self.safety.volts,
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
