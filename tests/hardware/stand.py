"""An emulated board in a thread, with its wheels off the ground: what hears a driver in tests."""

import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass, field

from harness import ROBOTS
from mecazen.config import HardwareConfig
from mecazen.loading import load_table
from mecazen.robot import Robot
from mecazen_hardware.emulator.emulator import Emulator
from mecazen_hardware.emulator.faults import Requested
from mecazen_hardware.emulator.firmware import Firmware, Instruments
from mecazen_hardware.emulator.line import Line
from mecazen_hardware.emulator.world import TICK_MS, motor_torque

ROBOT = load_table(ROBOTS / "rosmaster_x3.toml", Robot)
INERTIA = 8e-4
"""Inertia of a wheel with its share of the robot [kg·m²]."""
NO_FAULTS = Requested({}, {})
MOTION, RESET = 0x12, 0x0F


@dataclass
class Stand:
    """Wheels that turn freely, in the place of physics."""

    battery_v: float = 12.0
    has_begun: bool = False
    time_ns: int = 0
    news: dict = field(default_factory=dict)
    angles: list = field(default_factory=lambda: [0.0] * 4)
    speeds: list = field(default_factory=lambda: [0.0] * 4)

    def begin(self):
        self.has_begun = True

    def step(self, duty):
        for wheel, share in enumerate(duty):
            volts = None if share is None else share * self.battery_v
            torque, _ = motor_torque(volts, self.speeds[wheel])
            self.speeds[wheel] += torque / INERTIA * TICK_MS / 1000.0
            self.angles[wheel] += self.speeds[wheel] * TICK_MS / 1000.0

    def sense(self):
        return Instruments(tuple(self.angles), self.battery_v)


class Hearing(Firmware):
    """A board that notes when it took which frame."""

    def __post_init__(self):
        super().__post_init__()
        self.heard = []

    def _read(self, frame):
        super()._read(frame)
        self.heard.append((time.monotonic(), frame[3], frame[4:-1]))

    @property
    def stopped_after_s(self):
        """The time from the last frame that drives to the first one that stops the motors [s]."""
        drives = [function == MOTION and any(rest[1:]) for _, function, rest in self.heard]
        last = max(at for at, moves in enumerate(drives) if moves)
        stop = next(t for t, function, _ in self.heard[last + 1 :] if function in (MOTION, RESET))
        return stop - self.heard[last][0]


@contextmanager
def emulated(faults=NO_FAULTS, link=None, **firmware):
    """Yield a running emulator of a board on a stand."""
    line = Line(link)
    emulator = Emulator(line, Stand(), Hearing(**firmware), faults)
    stopped = threading.Event()
    thread = threading.Thread(target=emulator.run, args=(stopped.is_set,), daemon=True)
    thread.start()
    try:
        yield emulator
    finally:
        stopped.set()
        thread.join()
        line.close()


def config(emulator, **settings):
    return HardwareConfig(port=emulator.line.name, **settings)


def until(condition, timeout_s=5.0):
    """Wait for a condition."""
    end_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end_s, "it never happened"
        time.sleep(0.005)
