"""The board of Yahboom's ROSMASTER X3: its serial protocol, without port and clock.

A frame is `FF`, an id (`FC` to the board, `FB` to the host), a length, a function, a payload and a
checksum. The length counts itself and all bytes after it. The checksum is the sum of length,
function and payload, modulo 256. Numbers are little-endian.

Sources: the vendor's library `Rosmaster_Lib` 3.3.9 and its firmware `Rosmaster_V3.5.1`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from typing import ClassVar

from mecazen.config import HardwareConfig
from mecazen.geometry import Twist2D
from mecazen.robot import WHEELS, Robot
from mecazen.wheels import MecanumKinematics, WheelSpeeds

from mecazen_hardware.board import Board, Identity, Inertial, Report, Voltage, WheelAngles

START = b"\xff\xfb"
"""The first bytes of a frame to the host."""
CAR_TYPE = 1
"""Type of the X3 in the board's flash, which selects the board's kinematics."""
CAR_TYPES = {1: "X3", 2: "X3 Plus", 3: "mini", 4: "X1", 5: "R2", 6: "Sunrise", 10: "M1"}

AUTO_REPORT, RESET_STATE, DUTY, MOTION, REQUEST = 0x01, 0x0F, 0x10, 0x12, 0x50
STATUS, MPU9250, COUNTS, ICM20948, CAR, VERSION = 0x0A, 0x0B, 0x0D, 0x0E, 0x15, 0x51
PAYLOADS = {
    STATUS: "<hhhB",
    MPU9250: "<9h",
    0x0C: "<3h",
    COUNTS: "<4i",
    ICM20948: "<9h",
    0x13: "<B3H",
    0x14: "<B3H",
    CAR: "<BB",
    VERSION: "<BB",
}
"""Payloads of all frames to the host, by function, as in `struct`."""
LENGTHS = {function: struct.calcsize(form) + 3 for function, form in PAYLOADS.items()}

ORDER = (0, 2, 1, 3)
"""The board's motors m1 to m4 are front left, rear left, front right, rear right."""
CIRCUMFERENCE_M = 0.204203
COUNTS_PER_TURN = 1320
"""Constants with which the firmware converts counts to rim speeds."""
LEVER_M = 0.164555
"""Half the sum of track and wheelbase, a constant of the firmware [m]."""
RIM_LIMIT_M_S = 0.998
"""Maximum speed to which the driver commands a rim [m/s].

The firmware clips each wheel separately at 1 m/s, which would change the direction. The numbers of
a frame are rounded to 1 mm/s each, so a margin of 1.5 mm/s is needed."""
YAW_LIMIT_RAD_S = 5.0
"""The vendor's range of wz [rad/s]; that of vx and vy is wider than the rims allow."""
MPU_GYRO, MPU_ACCEL, ICM = 3754.9, 1671.84, 1000.0
"""Raw numbers per rad/s, m/s², and both."""


def frame(function: int, payload: bytes) -> bytes:
    """Return a complete frame to the board."""
    body = bytes((len(payload) + 3, function)) + payload
    return b"\xff\xfc" + body + bytes((sum(body) % 256,))


class RosmasterX3(Board):
    """The X3: a board that takes a twist, and has no command for the speed of each wheel."""

    CYCLE_S: ClassVar[float] = 0.041
    SPACING_S: ClassVar[float] = 0.0022
    """The board has one buffer of 20 bytes, which it reads every millisecond and then clears. The
    longest frame takes 1.04 ms on the line, and may wait in the buffer for 1 ms."""
    KINDS = (WheelAngles, Inertial, Voltage)

    def __init__(self, config: HardwareConfig, robot: Robot) -> None:
        super().__init__(config, robot)
        self._buffer = bytearray()
        self._version: tuple[int, ...] = ()
        self._car_type = 0
        per_turn = config.counts_per_turn or COUNTS_PER_TURN
        self._count = 2.0 * math.pi / per_turn
        """Angle of a wheel per count [rad]."""
        # rim speed in the board's units per rad/s of the wheel: the board uses its own constants
        rim = CIRCUMFERENCE_M / COUNTS_PER_TURN / self._count
        self._kinematics = MecanumKinematics(rim, LEVER_M / 2, LEVER_M / 2)

    def hello(self) -> Sequence[bytes]:
        return (  # none of these frames writes the board's flash
            frame(AUTO_REPORT, b"\x01\x00"),
            frame(REQUEST, bytes((VERSION, 0))),
            frame(REQUEST, bytes((CAR, 0))),
        )

    def feed(self, data: bytes) -> list[Report]:
        self._buffer += data
        reports = (self._report(*frame) for frame in self._take_frames())
        return [report for report in reports if report is not None]

    def _take_frames(self) -> Iterator[tuple[int, tuple[int, ...]]]:
        """Yield function and payload of each frame in the buffer.

        After an invalid frame the search restarts at its second byte, so a damaged frame never
        destroys the next one. Function and length must match, and no length is above 21, so a
        false start delays the next frame by at most that number of bytes.
        """
        buffer, begin, skipped = self._buffer, 0, 0
        while len(buffer) - begin >= 4:
            length, function = buffer[begin + 2], buffer[begin + 3]
            end = begin + 2 + length
            is_start = buffer[begin : begin + 2] == START and LENGTHS.get(function) == length
            if is_start and end > len(buffer):
                break
            if is_start and sum(buffer[begin + 2 : end - 1]) % 256 == buffer[end - 1]:
                self.frames += 1
                yield function, struct.unpack_from(PAYLOADS[function], buffer, begin + 4)
                begin = end
            else:
                begin += 1
                skipped += 1
        del buffer[:begin]
        self.refused += skipped > 0

    def _report(self, function: int, payload: tuple[int, ...]) -> Report | None:
        if function == COUNTS:
            a, b, c, d = (payload[motor] * self._count for motor in ORDER)
            return WheelAngles((a, b, c, d), 2**32 * self._count)
        if function == STATUS:
            return Voltage(payload[3] / 10.0)
        if function == MPU9250:
            x, y, z, ax, ay, az = payload[:6]
            angular = (x / MPU_GYRO, -y / MPU_GYRO, -z / MPU_GYRO)
            return Inertial(angular, (ax / MPU_ACCEL, ay / MPU_ACCEL, az / MPU_ACCEL))
        if function == ICM20948:
            x, y, z, ax, ay, az = payload[:6]
            return Inertial((x / ICM, y / ICM, z / ICM), (ax / ICM, ay / ICM, az / ICM))
        if function == VERSION:
            self._version = payload
        elif function == CAR:
            self._car_type = payload[0]
        else:
            return None
        return self._identity() if self._version and self._car_type else None

    def _identity(self) -> Identity:
        kind = CAR_TYPES.get(self._car_type, f"type {self._car_type}")
        name = f"ROSMASTER {kind}, firmware {'.'.join(map(str, self._version))}"
        if self._car_type == CAR_TYPE:
            return Identity(name)
        return Identity(name, f"it is set to the car {kind}, whose wheels turn otherwise; set X3")

    def drive(self, speeds: WheelSpeeds) -> tuple[bytes, WheelSpeeds]:
        """Return the frame of the twist nearest to wheel speeds, scaled to the limits."""
        if not all(map(math.isfinite, speeds)):
            raise ValueError(f"wheel speeds must be finite, not {tuple(speeds)}")
        twist = self._kinematics.forward(speeds)
        rim_m_s = abs(twist.x) + abs(twist.y) + LEVER_M * abs(twist.yaw)
        excess = max(1.0, rim_m_s / RIM_LIMIT_M_S, abs(twist.yaw) / YAW_LIMIT_RAD_S)
        numbers = [round(1000.0 * value / excess) for value in twist]
        driven = self._kinematics.inverse(Twist2D(*(number / 1000.0 for number in numbers)))
        return frame(MOTION, struct.pack("<B3h", CAR_TYPE, *numbers)), driven

    def stop(self) -> Sequence[bytes]:
        zero = frame(MOTION, struct.pack("<B3h", CAR_TYPE, 0, 0, 0))
        return (zero, frame(RESET_STATE, b"\x5f")) * 2  # a frame may be lost

    def turn_wheel(self, wheel: int, share: float) -> bytes:
        duty = [0] * len(WHEELS)  # the others coast
        duty[ORDER.index(wheel)] = round(100.0 * max(-1.0, min(share, 1.0)))
        return frame(DUTY, struct.pack("<4b", *duty))
