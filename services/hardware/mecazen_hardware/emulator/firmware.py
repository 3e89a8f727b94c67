"""The firmware of the ROSMASTER X3's board, in steps of a millisecond, from bytes to bytes.

The emulation is written from the vendor's source (`Rosmaster_V3.5.1`) and not from the driver. It
reproduces the firmware's faults: one buffer of 20 bytes, no watchdog, a motor loop with a fixed
offset, a latch on low battery. It uses neither port nor clock nor physics.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import NamedTuple

BUFFER_BYTES = 20
CYCLE_MS = 41
"""The counter of the report task runs from 0 to 40."""
CONTROL_MS, BATTERY_MS = 10, 100
SPEED_AT, IMU_AT, ATTITUDE_AT, COUNTS_AT = 0, 10, 20, 30
"""The values of the counter at which a report is due."""
COUNTS_PER_RAD = 1320 / math.tau
COUNT_MM = 204.203 / 1320
LEVER_MM = 164.555
RIM_LIMIT = 1000.0
"""Speed at which each wheel is clipped, independent of the others [mm/s]."""
PID_LIMIT, OFFSET, PWM_FULL = 2000.0, 1600.0, 3600.0
DUTY_STEP = 20.0
"""PWM counts per percent of an open-loop duty."""
LOW_V, HIGH_V, DEAD_V, TWO_CELLS_V = 9.6, 13.0, 6.5, 8.5
LATCH_READINGS = 20
VERSION = 3, 5
P_GAIN, I_GAIN, D_GAIN = 0.8, 0.06, 0.5
"""Gains of the motor loop after power-on."""


class Instruments(NamedTuple):
    """Measurements of the board.

    Angles of the wheels at m1 to m4 [rad], supply [V], and in base_link the angular velocity
    [rad/s], the specific force [m/s²], and roll, pitch and yaw [rad].
    """

    angles: tuple[float, float, float, float] = (0.0,) * 4
    volts: float = 12.0
    gyro: tuple[float, float, float] = (0.0,) * 3
    accel: tuple[float, float, float] = (0.0, 0.0, 9.81)
    attitude: tuple[float, float, float] = (0.0,) * 3


@dataclass
class WheelPid:
    """The incremental controller of one wheel, in mm/s."""

    out: float = 0.0
    last: float = 0.0
    before: float = 0.0

    def update(self, error: float) -> float:
        """Return the output for the error of this cycle."""
        change, bend = error - self.last, error - 2 * self.last + self.before
        self.out = _within(self.out + P_GAIN * change + I_GAIN * error + D_GAIN * bend, PID_LIMIT)
        self.before, self.last = self.last, error
        return self.out


class Firmware:
    """The board after power-on; `car_type` is in its flash."""

    def __init__(self, car_type: int = 1) -> None:
        self.car_type = car_type
        self.duty: list[float | None] = [0.0] * 4
        """Share of the battery's voltage at each motor, m1 to m4, from -1 to 1; None lets a motor
        coast, 0.0 brakes it."""
        self.goal = [0.0] * 4
        """Speeds that the motor loop holds [mm/s]."""
        self.is_latched = False
        """Whether a low or too high battery voltage has switched the motors off, until a reset."""
        self.taken = self.lost = 0
        """Numbers of frames that were accepted, and that were overwritten or damaged."""
        self.frame = b""
        """A whole frame that the task has not read yet; the next byte destroys the frame."""
        self._ms = self._low = 0
        self._bytes = bytearray()
        self._reports, self._has_loop = True, False
        self._pids = [WheelPid() for _ in range(4)]
        self._counts = [0] * 4
        self._speeds = [0.0] * 4
        self._measured = Instruments()
        self._answers = b""

    def receive(self, byte: int) -> None:
        """Take a byte, as `Upper_Data_Receive` does."""
        if self.frame:  # the one buffer holds a frame that the task has not read yet
            self.frame = b""
            self.lost += 1
        self._bytes.append(byte)
        count = len(self._bytes)
        if count <= 2:
            if byte != (0xFF, 0xFC)[count - 1]:
                self._bytes.clear()  # FF FF FC loses the frame
        elif count == 3 and not 3 <= byte <= BUFFER_BYTES - 3:
            self.lost += 1
            self._bytes.clear()
        elif count == self._bytes[2] + 2:
            self.frame = bytes(self._bytes)
            self._bytes.clear()

    def millisecond(self, measured: Instruments) -> bytes:
        """Run all tasks of one millisecond; return what the board sends."""
        self._measured = measured
        if self.frame:
            self._read(self.frame)
            self.frame = b""
            self._bytes.clear()
        sent, self._answers = self._answers, b""
        if self._ms % CONTROL_MS == 0:
            self._control()
        if self._ms % BATTERY_MS == 0:
            self._watch_battery(measured.volts)
        if self._reports and not self.is_latched:
            sent += self._report(self._ms % CYCLE_MS)
        self._ms += 1
        return sent

    def _read(self, frame: bytes) -> None:
        if sum(frame[2:-1]) % 256 != frame[-1]:
            self.lost += 1
            return
        self.taken += 1
        if not self.is_latched or frame[3] in {0x0F, 0x50}:
            self._execute(frame[3], frame[4:-1])

    def _execute(self, function: int, payload: bytes) -> None:
        """Execute a command; others (lights, servos, steering, settings) are ignored."""
        match function, *payload:
            case 0x01, on, *_:
                self._reports = bool(on)
            case 0x0F, 0x5F, *_:
                self._brake()
                self.is_latched, self._low = False, 0
            case 0x10, _, _, _, _ if not self._has_loop:  # else it overwrites the duty in 10 ms
                percents = struct.unpack("<4b", payload)
                self.duty = [
                    _duty(DUTY_STEP * percent) if percent else None for percent in percents
                ]
            case 0x12, _, _, _, _, _, _, _:
                self._move(*struct.unpack("<3h", payload[1:]))
            case 0x50, 0x51, _:
                self._answers += _frame(0x51, bytes(VERSION))
            case 0x50, 0x15, _:
                self._answers += _frame(0x15, bytes((self.car_type, 0)))

    def _move(self, x: int, y: int, yaw: int) -> None:
        """Drive a twist [mm/s, mrad/s]."""
        if x == y == yaw == 0:
            self._brake()
            return
        turn = yaw / 1000.0 * LEVER_MM
        rims = (x - y - turn, x + y - turn, x + y + turn, x - y + turn)
        self.goal = [_within(speed, RIM_LIMIT) for speed in rims]
        self._has_loop = True

    def _brake(self) -> None:
        self._has_loop = False
        self.goal, self.duty = [0.0] * 4, [0.0] * 4
        self._pids = [WheelPid() for _ in range(4)]

    def _control(self) -> None:
        before = self._counts
        self._counts = [math.floor(angle * COUNTS_PER_RAD) for angle in self._measured.angles]
        self._speeds = [
            (new - old) * COUNT_MM / (CONTROL_MS / 1000.0)
            for new, old in zip(self._counts, before, strict=True)
        ]
        if self._has_loop and not self.is_latched:
            self.duty = [
                _duty(pid.update(goal - speed))
                for pid, goal, speed in zip(self._pids, self.goal, self._speeds, strict=True)
            ]

    def _watch_battery(self, volts: float) -> None:
        is_bad = TWO_CELLS_V < volts < LOW_V or volts > HIGH_V or volts < DEAD_V
        self._low = self._low + 1 if is_bad else 0
        if self._low > LATCH_READINGS:
            self.is_latched = True
            self._brake()

    def _report(self, counter: int) -> bytes:
        measured = self._measured
        if counter == SPEED_AT:
            m1, m2, m3, m4 = self._speeds
            x, y = (m1 + m2 + m3 + m4) / 4, (-m1 + m2 + m3 - m4) / 4
            yaw = (-m1 - m2 + m3 + m4) / 4 / LEVER_MM * 1000.0
            tenths = min(max(int(measured.volts * 10.0), 0), 255)
            return _frame(0x0A, struct.pack("<3hB", _int16(x), _int16(y), _int16(yaw), tenths))
        if counter == IMU_AT:
            raw = (*measured.gyro, *measured.accel, 0.0, 0.0, 0.0)
            return _frame(0x0E, struct.pack("<9h", *(_int16(1000.0 * value) for value in raw)))
        if counter == ATTITUDE_AT:
            angles = (_int16(10_000.0 * angle) for angle in measured.attitude)
            return _frame(0x0C, struct.pack("<3h", *angles))
        if counter == COUNTS_AT:
            counts = ((count + 2**31) % 2**32 - 2**31 for count in self._counts)
            return _frame(0x0D, struct.pack("<4i", *counts))
        return b""


def _frame(function: int, payload: bytes) -> bytes:
    body = bytes((len(payload) + 3, function)) + payload
    return b"\xff\xfb" + body + bytes((sum(body) % 256,))


def _duty(pwm: float) -> float:
    """Return the duty of a PWM value with the offset against friction, clipped at full scale."""
    return _within(pwm + math.copysign(OFFSET, pwm), PWM_FULL) / PWM_FULL if pwm else 0.0


def _within(value: float, limit: float) -> float:
    return max(-limit, min(value, limit))


def _int16(value: float) -> int:
    return max(-(2**15), min(int(value), 2**15 - 1))
