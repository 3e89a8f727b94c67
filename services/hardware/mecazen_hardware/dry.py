"""A dry run: frames are printed, and the wheels turn as commanded. No port is opened."""

from __future__ import annotations

import sys
import time

from mecazen.wheels import WheelSpeeds

from mecazen_hardware.board import Board, Identity, MeasuredSpeeds, Report, Voltage

VOLTS = 12.0
"""The voltage that a dry run reports [V]."""


class DryLink:
    """The methods of a `Link` that the nodes call, without a board.

    Args:
        board: The protocol.
    """

    identity = Identity("dry run")
    sent = unsent = 0

    def __init__(self, board: Board) -> None:
        self.board = board
        self._speeds = WheelSpeeds()
        self._reported_s = 0.0
        self._printed = ""

    def read(self) -> list[tuple[Report, float]]:
        """Return the commanded wheel speeds as reports, once in a cycle of the board."""
        now_s = time.monotonic()
        if now_s - self._reported_s < self.board.CYCLE_S:
            return []
        self._reported_s = now_s
        return [(MeasuredSpeeds(self._speeds), now_s), (Voltage(VOLTS), now_s)]

    def drive(self, speeds: WheelSpeeds) -> WheelSpeeds:
        """Print the frame for wheel speeds [rad/s], if it differs from the last one."""
        frame, self._speeds = self.board.drive(speeds)
        self._print(frame)
        return self._speeds

    def stop(self) -> None:
        """Print the frames that stop the motors."""
        self._speeds = WheelSpeeds()
        for frame in self.board.stop():
            self._print(frame)

    def poll(self) -> None:
        """Do nothing: reports need no request."""

    def close(self) -> None:
        """Print the frames that stop the motors."""
        self.stop()

    def _print(self, frame: bytes) -> None:
        line = f"{frame.hex(' ')}  {self.board.explain(frame)}\n"
        if line != self._printed:
            self._printed = line
            sys.stdout.write(line)
            sys.stdout.flush()
