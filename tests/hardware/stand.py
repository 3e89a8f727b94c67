"""An emulated board in a thread, with its wheels off the ground, and frames to and from it."""

import random
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass, field

from harness import ROBOTS
from mecazen.config import HardwareConfig
from mecazen.loading import load_table
from mecazen.robot import Robot
from mecazen_hardware.emulator.firmware import Firmware, Instruments
from mecazen_hardware.emulator.line import Emulator, SerialLine
from mecazen_hardware.emulator.world import TICK_MS, motor_torque
from mecazen_hardware.link import Link

ROBOT = load_table(ROBOTS / "rosmaster_x3.toml", Robot)
INERTIA = 8e-4
"""Inertia of a wheel with its share of the robot [kg·m²]."""
MOTION, RESET = 0x12, 0x0F
STOP_WITHIN_S = 3.0
"""Time after the last command within which a stop frame has to come [s]. With a free core it is
0.5 s; where tests of other parts share two cores, the keeper itself waited for one up to 0.4 s."""


def frame(function, payload=b"", head=b"\xff\xfc"):
    body = bytes((len(payload) + 3, function)) + payload
    return head + body + bytes((sum(body) % 256,))


def to_host(function, payload):
    return frame(function, payload, b"\xff\xfb")


@dataclass
class Stand:
    """Wheels that turn freely, in the place of physics."""

    battery_v: float = 12.0
    angles: list = field(default_factory=lambda: [0.0] * 4)
    speeds: list = field(default_factory=lambda: [0.0] * 4)

    @property
    def measured(self):
        return Instruments(tuple(self.angles), self.battery_v)

    def step(self, duty):
        for wheel, share in enumerate(duty):
            volts = None if share is None else share * self.battery_v
            torque, _ = motor_torque(volts, self.speeds[wheel])
            self.speeds[wheel] += torque / INERTIA * TICK_MS / 1000.0
            self.angles[wheel] += self.speeds[wheel] * TICK_MS / 1000.0


class LoggingFirmware(Firmware):
    """A board that keeps the frames that it has accepted, with their times."""

    def __init__(self, **settings):
        super().__init__(**settings)
        self.log = []

    def _execute(self, function, payload):
        super()._execute(function, payload)
        self.log.append((time.monotonic(), function, payload))

    @property
    def driving(self):
        """The numbers of the frames that drive."""
        moves = (function == MOTION and any(payload[1:]) for _, function, payload in self.log)
        return [number for number, is_moving in enumerate(moves) if is_moving]

    @property
    def stopped_after_s(self):
        """The time from the last frame that drives to the first one that stops the motors [s]."""
        last = self.driving[-1]
        stop = next(t for t, function, _ in self.log[last + 1 :] if function in (MOTION, RESET))
        return stop - self.log[last][0]


class FaultyLine(SerialLine):
    """A line that loses, cuts or corrupts a share of what it carries both ways, or is silent."""

    def __init__(self, damage):
        super().__init__()
        self.is_silent = False
        self._damage, self._random = damage, random.Random(1)

    def _pass_on(self, data):
        if not data or self._random.random() >= self._damage:
            return data
        place = self._random.randrange(len(data))
        flipped = bytes((data[place] ^ 0x55,)) + data[place + 1 :]
        return self._random.choice((b"", data[:place], data[:place] + flipped))

    def read(self):
        return self._pass_on(super().read())

    def millisecond(self, data):
        super().millisecond(b"" if self.is_silent else self._pass_on(data))


@contextmanager
def emulated(damage=0.0, world=None, **firmware):
    """Yield a running emulator of a board, on a stand or in a world."""
    line = FaultyLine(damage)
    emulator = Emulator(line, world or Stand(), LoggingFirmware(**firmware))
    stopped = threading.Event()
    thread = threading.Thread(target=emulator.run, args=(stopped,), daemon=True)
    thread.start()
    try:
        yield emulator
    finally:
        stopped.set()
        thread.join()
        line.close()


@contextmanager
def linked(emulator):
    """Yield the link to an emulated board."""
    link = Link(HardwareConfig(port=emulator.line.name), ROBOT)
    try:
        yield link
    finally:
        link.close()


def until(condition):
    """Wait for a condition."""
    end_s = time.monotonic() + 5.0
    while not condition():
        assert time.monotonic() < end_s, "it never happened"
        time.sleep(0.005)
