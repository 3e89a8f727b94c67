"""DJI's RoboMaster EP: its text protocol, over TCP or serial, without port and clock.

A command is ASCII text that ends with `;`, such as `chassis wheel w1 100 w2 100 w3 100 w4 100;`.
Each command gets one answer: `ok`, `error`, or numbers. The robot controls the speed of each wheel
itself, so `joint_command` needs no conversion to a twist.

Source: DJI's documentation of the text SDK in `RoboMaster-SDK`, `protocol_api.rst`. The checklist
    verifies what this source leaves open, such as the order of the rear wheels.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import ClassVar

from mecazen.config import HardwareConfig
from mecazen.robot import Robot
from mecazen.wheels import WheelSpeeds

from mecazen_hardware.board import Board, Identity, MeasuredSpeeds, Report

MAX_RPM = 1000
"""Maximum speed of a wheel; the robot answers a faster command with `error`."""
RPM_PER_RAD_S = 30.0 / math.pi
ORDER = (1, 0, 3, 2)
"""Wheels w1 to w4 are front right, front left, rear right, rear left."""
LONGEST = 256
"""Maximum number of bytes without a `;` in the answers of this robot."""
VERSION_WORDS = 1
SPEED_WORDS = 7
"""Words of the answer to `chassis speed ?`: x, y, z, and the speeds of the four wheels [rpm]."""


class RobomasterEp(Board):
    """The EP: a board that takes the speed of each wheel, and measures these speeds."""

    CYCLE_S: ClassVar[float] = 0.05
    """The driver requests the wheel speeds: the robot's push messages do not contain them."""
    SPACING_S: ClassVar[float] = 0.02
    """Each command waits for its answer: the robot does not queue commands."""
    KINDS = (MeasuredSpeeds,)

    def __init__(self, config: HardwareConfig, robot: Robot) -> None:
        super().__init__(config, robot)
        self._buffer = bytearray()
        self._limit = min(robot.wheels.max_speed_rad_s, MAX_RPM / RPM_PER_RAD_S)

    def hello(self) -> Sequence[bytes]:
        """Enter SDK mode, free the chassis from the gimbal, and ask for the version."""
        return b"command;", b"robot mode free;", b"version;"

    def poll(self) -> bytes:
        """Ask for the speeds of the wheels."""
        return b"chassis speed ?;"

    def feed(self, data: bytes) -> list[Report]:
        """Return the reports that the bytes complete; other text is skipped."""
        self._buffer += data
        *answers, rest = self._buffer.split(b";")
        if len(rest) > LONGEST:
            rest = rest[:0]
            self.refused += 1
        self._buffer = rest
        return [report for answer in answers for report in self._read(bytes(answer))]

    def _read(self, answer: bytes) -> Iterator[Report]:
        try:
            words = answer.decode("ascii").split()
        except UnicodeDecodeError:
            words = []
        if words and words[0] == "version":
            words = words[1:]
        if len(words) == VERSION_WORDS and words[0].count(".") >= 2:
            self.frames += 1
            if words[0].replace(".", "").isdigit():
                yield Identity(f"RoboMaster EP, firmware {words[0]}")
        elif len(words) == SPEED_WORDS and (numbers := _numbers(words)):
            self.frames += 1
            yield MeasuredSpeeds(self._of_wheels(numbers[3:]))
        elif words in (["ok"], ["error"]):
            self.frames += 1
        else:
            self.refused += 1

    def _of_wheels(self, rpm: Sequence[float]) -> WheelSpeeds:
        return WheelSpeeds(*(rpm[ORDER.index(wheel)] / RPM_PER_RAD_S for wheel in range(4)))

    def drive(self, speeds: WheelSpeeds) -> tuple[bytes, WheelSpeeds]:
        """Return the command for wheel speeds, all scaled by one factor to the wheels' limit.

        Raises:
            ValueError: A speed is not finite.
        """
        if not all(map(math.isfinite, speeds)):
            raise ValueError(f"wheel speeds must be finite, not {tuple(speeds)}")
        slowed = WheelSpeeds(*speeds).desaturate(self._limit)
        rpm = [round(slowed[wheel] * RPM_PER_RAD_S) for wheel in ORDER]
        return _wheels(rpm), self._of_wheels(rpm)

    def stop(self) -> Sequence[bytes]:
        """Return the command for zero speeds, twice: a command may be lost."""
        return (_wheels([0] * 4),) * 2

    def turn_one(self, wheel: int, share: float) -> bytes:
        """Return the command that turns one wheel."""
        rpm = [0] * 4
        rpm[ORDER.index(wheel)] = round(max(-1.0, min(share, 1.0)) * self._limit * RPM_PER_RAD_S)
        return _wheels(rpm)

    def explain(self, frame: bytes) -> str:
        """Return the text of a command."""
        return frame.decode("ascii")


def _wheels(rpm: Sequence[int]) -> bytes:
    words = " ".join(f"w{number} {speed}" for number, speed in enumerate(rpm, 1))
    return f"chassis wheel {words};".encode()


def _numbers(words: Sequence[str]) -> list[float]:
    """Return the words as finite numbers; empty if a word is not a finite number."""
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []
