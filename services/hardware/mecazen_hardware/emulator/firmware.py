"""The firmware of the ROSMASTER X3's board, in steps of a millisecond, from bytes to bytes.

The emulation is written from the vendor's source (`Rosmaster_V3.5.1`) and not from the driver. It
reproduces the firmware's faults: one buffer of 20 bytes, no watchdog, a motor loop with a fixed
offset, a latch on low battery. It uses neither port nor clock nor physics.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

BUFFER_BYTES = 20
CYCLE_MS = 41
"""The counter of the report task runs from 0 to 40."""
CONTROL_MS = 10
BATTERY_MS = 100
REPORTS = {0: "speed", 10: "imu", 20: "attitude", 30: "counts"}
"""The report at each value of the counter."""
BOOT_MS = 40
"""Time from power-on until the reports start."""
CIRCUMFERENCE_MM = 204.203
COUNTS_PER_TURN = 1320
LEVER_MM = 164.555
RIM_LIMIT = 1000.0
"""Speed at which each wheel is clipped, independent of the others [mm/s]."""
PID_LIMIT, OFFSET, PWM_FULL = 2000.0, 1600.0, 3600.0
DUTY_STEP = 20.0
"""PWM counts per percent of an open-loop duty."""
LOW_V, HIGH_V, DEAD_V, TWO_CELLS_V = 9.6, 13.0, 6.5, 8.5
LATCH_READINGS = 20
KINEMATICS = {1, 2, 3, 10}
"""Types of car that have mecanum wheels."""


class Instruments(NamedTuple):
    """Measurements of the board."""

    angles: tuple[float, float, float, float] = (0.0,) * 4
    """Angles of the wheels at motors m1 to m4 [rad], which the encoders count."""
    volts: float = 12.0
    gyro: tuple[float, float, float] = (0.0,) * 3
    """[rad/s], in base_link."""
    accel: tuple[float, float, float] = (0.0, 0.0, 9.81)
    """[m/s²], in base_link."""
    attitude: tuple[float, float, float] = (0.0,) * 3
    """Roll, pitch, yaw [rad]."""


@dataclass
class Pid:
    """The incremental controller of one wheel, in mm/s."""

    gains: tuple[float, float, float]
    out: float = 0.0
    last: float = 0.0
    before: float = 0.0

    def update(self, error: float) -> float:
        """Return the output for the error of this cycle."""
        p, i, d = self.gains
        self.out += p * (error - self.last) + i * error + d * (error - 2 * self.last + self.before)
        self.out = _within(self.out, PID_LIMIT)
        self.before, self.last = self.last, error
        return self.out


@dataclass
class Firmware:
    """The board after power-on.

    Attributes:
        duty: Share of the battery's voltage at each motor, m1 to m4, from -1 to 1; None lets a
            motor coast, 0.0 brakes it.
    """

    car_type: int = 1
    version: tuple[int, int] = (3, 5)
    counts_per_turn: float = COUNTS_PER_TURN
    duty: list[float | None] = field(default_factory=lambda: [0.0] * 4)
    goal: list[float] = field(default_factory=lambda: [0.0] * 4)
    """Speeds that the motor loop holds [mm/s]."""
    is_latched: bool = False
    """Whether a low or too high battery voltage has switched the motors off, until a reset."""
    lost: int = 0
    """Number of frames that were overwritten in the buffer or had a wrong checksum."""
    taken: int = 0
    """Number of frames that were accepted."""
    drives: bool = False
    """Whether a frame has ever commanded the motors, even to rest."""
    jump: int = 0
    """Counts that are added to the first encoder, for the fault `jump`."""

    def __post_init__(self) -> None:
        self._ms = 0
        self._volts = 0.0
        self._whole = b""
        """A frame that the task has not read yet; the next byte destroys the frame."""
        self._reports = True
        self._loop = False
        self._gains = (0.8, 0.06, 0.5)
        self._yaw_gains = (0.4, 0.0, 0.1)
        self._pids = [Pid(self._gains) for _ in range(4)]
        self._counted = [0] * 4
        self._speeds = [0.0] * 4
        self._low = 0
        self._answers: list[bytes] = []
        self._restart()

    def _restart(self) -> None:
        self._frame = bytearray()
        self._left = 0

    # the receiver: an interrupt for each byte, a task for each millisecond

    @property
    def is_full(self) -> bool:
        """Whether a whole frame waits for the task."""
        return bool(self._whole)

    def receive(self, byte: int) -> None:
        """Take a byte, as `Upper_Data_Receive` does."""
        frame = self._frame
        if self._whole:  # the one buffer holds a frame that the task has not read yet
            self._whole = b""
            self.lost += 1
        match len(frame):
            case 0:
                if byte == 0xFF:
                    frame.append(byte)
            case 1:
                if byte == 0xFC:
                    frame.append(byte)
                else:  # FF FF FC loses the frame: the second FF is not treated as a start
                    self._restart()
            case 2:
                frame.append(byte)
                self._left = byte - 1
                if not 3 <= byte <= BUFFER_BYTES - 3:
                    self.lost += 1
                    self._restart()
            case _:
                frame.append(byte)
                self._left -= 1
                if self._left == 0:
                    self._whole = bytes(frame)
                    self._restart()

    def millisecond(self, sensed: Callable[[], Instruments]) -> bytes:
        """Run all tasks of one millisecond; return what the board sends."""
        if self._whole:
            self._read(self._whole)
            self._whole = b""
            self._restart()
        sent = b"".join(self._answers)
        self._answers.clear()
        counter = (self._ms - BOOT_MS) % CYCLE_MS
        due = self._ms % CONTROL_MS == 0 or self._ms % BATTERY_MS == 0 or counter in REPORTS
        if due:
            seen = sensed()
            if self._ms % CONTROL_MS == 0:
                self._control(seen)
            if self._ms % BATTERY_MS == 0:
                self._watch_battery(seen.volts)
            if self._ms >= BOOT_MS and self._reports and not self.is_latched:
                sent += self._report(REPORTS.get(counter, ""), seen)
        self._ms += 1
        return sent

    def _read(self, frame: bytes) -> None:
        if sum(frame[2:-1]) % 256 != frame[-1]:
            self.lost += 1
            return
        self.taken += 1
        function, payload = frame[3], frame[4:-1]
        if self.is_latched and function not in {0x0F, 0x15, 0x50}:
            return
        self.drives |= function in {0x10, 0x11, 0x12}
        form, command = _COMMANDS.get(function, ("", None))
        if command is not None and len(payload) >= struct.calcsize(form):
            command(self, *struct.unpack_from(form, payload))

    # commands

    def _auto_report(self, on: int) -> None:
        self._reports = bool(on)

    def _reset(self, confirm: int) -> None:
        if confirm == 0x5F:
            self._brake()
            self.is_latched = False
            self._low = 0

    def _open_loop(self, *duty: int) -> None:
        if self._loop:
            return  # the loop, once started, overwrites the duty within 10 ms
        pwm = [DUTY_STEP * percent for percent in duty]
        self.duty = [_offset(value) / PWM_FULL if value else None for value in pwm]

    def _steer(self, kind: int, state: int, speed: int) -> None:
        speed, turn = speed * 10, speed * 50
        twists = {
            1: (speed, 0, 0),
            2: (-speed, 0, 0),
            3: (0, speed, 0),
            4: (0, -speed, 0),
            5: (0, 0, turn),
            6: (0, 0, -turn),
        }
        self._move(kind, *twists.get(state, (0, 0, 0)))

    def _move(self, kind: int, x: int, y: int, yaw: int) -> None:
        del kind  # the kinematics follow the type in flash
        if x == y == yaw == 0:
            self._brake()
            return
        turn = yaw / 1000.0 * LEVER_MM
        side = y if self.car_type in KINEMATICS else 0
        self.goal = [
            _within(speed, RIM_LIMIT)
            for speed in (x - side - turn, x + side - turn, x + side + turn, x - side + turn)
        ]
        self._loop = True

    def _brake(self) -> None:
        self._loop = False
        self.goal, self.duty = [0.0] * 4, [0.0] * 4
        self._pids = [Pid(self._gains) for _ in range(4)]

    def _set_pid(self, p: int, i: int, d: int) -> None:
        self._gains = (p / 1000.0, i / 1000.0, d / 1000.0)
        for pid in self._pids:
            pid.gains = self._gains

    def _set_yaw_pid(self, p: int, i: int, d: int) -> None:
        self._yaw_gains = (p / 1000.0, i / 1000.0, d / 1000.0)

    def _set_car(self, kind: int, save: int) -> None:
        if save == 0x5F:
            self.car_type = kind

    def _request(self, function: int, parameter: int) -> None:
        match function:
            case 0x51:
                self._answers.append(_frame(0x51, bytes(self.version)))
            case 0x15:
                self._answers.append(_frame(0x15, bytes((self.car_type, 0))))
            case 0x13 if 1 <= parameter <= 4:
                self._answers.append(_pid_frame(0x13, parameter, self._gains))
            case 0x13 if parameter == 5:
                self._answers.append(_pid_frame(0x14, parameter, self._yaw_gains))
            case 0x01:
                self._answers.append(self._speed_frame(self._volts))

    # motors, encoders and reports

    def _control(self, seen: Instruments) -> None:
        per_radian = self.counts_per_turn / math.tau
        counts = [math.floor(angle * per_radian) for angle in seen.angles]
        counts[0] += self.jump
        to_speed = CIRCUMFERENCE_MM / COUNTS_PER_TURN / (CONTROL_MS / 1000.0)
        moved = (new - old for new, old in zip(counts, self._counted, strict=True))
        self._speeds = [change * to_speed for change in moved]
        self._counted = counts
        if self._loop and not self.is_latched:
            errors = (goal - speed for goal, speed in zip(self.goal, self._speeds, strict=True))
            outs = (pid.update(error) for pid, error in zip(self._pids, errors, strict=True))
            self.duty = [_offset(out) / PWM_FULL for out in outs]

    def _watch_battery(self, volts: float) -> None:
        self._volts = volts
        is_bad = TWO_CELLS_V < volts < LOW_V or volts > HIGH_V or volts < DEAD_V
        self._low = self._low + 1 if is_bad else 0
        if self._low > LATCH_READINGS:
            self.is_latched = True
            self._brake()

    def _report(self, kind: str, seen: Instruments) -> bytes:
        match kind:
            case "speed":
                return self._speed_frame(seen.volts)
            case "imu":
                raw = [1000.0 * value for value in (*seen.gyro, *seen.accel)]
                return _frame(0x0E, struct.pack("<9h", *map(_int16, (*raw, 0.0, 0.0, 0.0))))
            case "attitude":
                raw = [10_000.0 * angle for angle in seen.attitude]
                return _frame(0x0C, struct.pack("<3h", *map(_int16, raw)))
            case "counts":
                counts = [(count + 2**31) % 2**32 - 2**31 for count in self._counted]
                return _frame(0x0D, struct.pack("<4i", *counts))
        return b""

    def _speed_frame(self, volts: float) -> bytes:
        m1, m2, m3, m4 = self._speeds
        x, y = (m1 + m2 + m3 + m4) / 4, (-m1 + m2 + m3 - m4) / 4
        yaw = (-m1 - m2 + m3 + m4) / 4 / LEVER_MM * 1000.0
        tenths = min(max(int(volts * 10.0), 0), 255)
        return _frame(0x0A, struct.pack("<3hB", _int16(x), _int16(y), _int16(yaw), tenths))


_COMMANDS: dict[int, tuple[str, Callable[..., None]]] = {
    0x01: ("<B", Firmware._auto_report),
    0x0F: ("<B", Firmware._reset),
    0x10: ("<4b", Firmware._open_loop),
    0x11: ("<BBh", Firmware._steer),
    0x12: ("<B3h", Firmware._move),
    0x13: ("<3H", Firmware._set_pid),
    0x14: ("<3H", Firmware._set_yaw_pid),
    0x15: ("<BB", Firmware._set_car),
    0x50: ("<BB", Firmware._request),
}
"""The payload and the method of each command; other commands (lights, servos, arm) are ignored."""


def _frame(function: int, payload: bytes) -> bytes:
    body = bytes((len(payload) + 3, function)) + payload
    return b"\xff\xfb" + body + bytes((sum(body) % 256,))


def _pid_frame(function: int, index: int, gains: Sequence[float]) -> bytes:
    numbers = (round(1000.0 * gain) for gain in gains)
    return _frame(function, struct.pack("<B3H", index, *numbers))


def _offset(pwm: float) -> float:
    """Return a PWM value with the offset against friction, clipped at full scale."""
    return _within(pwm + math.copysign(OFFSET, pwm), PWM_FULL) if pwm else 0.0


def _within(value: float, limit: float) -> float:
    return max(-limit, min(value, limit))


def _int16(value: float) -> int:
    return max(-(2**15), min(int(value), 2**15 - 1))
