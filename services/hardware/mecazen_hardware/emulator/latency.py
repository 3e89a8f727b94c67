"""Wall-clock latency from `joint_command` to the line, and from a report to `joint_states`."""

from __future__ import annotations

import math
import random
import re
import select
import time
from pathlib import Path

import msgspec
from mecazen import keys
from mecazen.bus.zenoh_bus import ZenohBus
from mecazen.config import Process
from mecazen.errors import MecazenError
from mecazen.geometry import Twist2D
from mecazen.loading import load_scenario, parse_settings
from mecazen.messages import JointState, Twist
from mecazen.wire import Stamp
from mecazen_tools.processes import Supervisor, private_router

from mecazen_hardware.emulator.firmware import Firmware, Instruments
from mecazen_hardware.emulator.line import Line

START_S = 20.0
COMMAND_S = 0.037
"""Time between two commands of the robot's velocity [s]; the controller's ramps are in between."""
BEFORE_S = 0.005
"""Maximum time by which a frame may arrive before its command is received [s]."""
_MOTION = re.compile(b"\xff\xfc\x0a\x12\x01(..)", re.DOTALL)
"""A frame that commands a twist; the group is the forward speed."""
RIM_MM = 1000.0 * 0.204203 / math.tau
"""Speed of the rim [mm/s] per rad/s, by the firmware's constants."""
STEP_RAD, STEP_MS = 1.0, 250
"""Angle by which the wheels jump [rad], and time between two jumps [ms]: about six cycles of the
board, a whole number of its encoder cycles."""
SEEN_RAD_S = 5.0
"""Speed above which `joint_states` shows a jump [rad/s]."""


class Latency(msgspec.Struct):
    """Number of samples, percentiles and maximum [ms]."""

    samples: int
    p50_ms: float
    p99_ms: float
    max_ms: float


def measure(path: Path, duration_s: float, tick_s: float) -> dict[str, Latency]:
    """Return the latency of commands and of reports of a driver in a separate process.

    Raises:
        MecazenError: The driver did not start.
    """
    line = Line()
    settings = (
        *('services=["hardware","controller"]', "robot=rosmaster_x3", "guard.enabled=false"),
        *(f"hardware.port={line.name}", f"sim.tick_s={tick_s}"),
        *private_router(),
    )
    supervisor = Supervisor(path, settings)
    try:
        supervisor.start_router()
        bus = ZenohBus(load_scenario(path, parse_settings(settings)).bus)
        try:
            for service in ("hardware", "controller"):
                supervisor.start(Process((service,)))
            peer = _Peer(line, bus)
            peer.run(START_S, supervisor, until_driven=True)
            peer.run(duration_s, supervisor)
        finally:
            bus.close()
    finally:
        supervisor.stop()
        line.close()
    return {"command": _of(peer.commands_s), "report": _of(peer.reports_s)}


class _Peer:
    """The peer of the driver: its board, the client that commands, and the client that listens."""

    def __init__(self, line: Line, bus: ZenohBus) -> None:
        self.commands_s: list[float] = []
        self.reports_s: list[float] = []
        self._line, self._bus = line, bus
        self._board = Firmware()
        self._draw = random.Random(1)  # noqa: S311  # no secret
        self._put = bus.publisher(keys.CMD_VEL).put
        self._commanded: tuple[int, float] | None = None
        """A speed that the controller has commanded [mm/s], and the time of its reception [s]."""
        self._last = 0
        self._on_line: dict[int, float] = {}
        """Time at which each speed was last on the line [s], by the speed [mm/s]."""
        self._jumped_s: float | None = None
        self._angle, self._is_sent = 0.0, False
        bus.subscribe(keys.JOINT_STATES, self._on_joints)
        bus.subscribe(keys.JOINT_COMMAND, self._on_command)

    def run(self, duration_s: float, supervisor: Supervisor, *, until_driven: bool = False) -> None:
        """Measure for some time, or wait until the driver has begun to drive.

        Raises:
            MecazenError: The driver has not begun.
        """
        begin_s = next_s = time.monotonic()
        ms = 0
        while (now_s := time.monotonic()) < begin_s + duration_s:
            if until_driven and self._board.drives:
                return
            if supervisor.poll(0.0) is not None:
                break
            self._bus.spin_once(0.0)
            self._listen()
            if now_s >= next_s and self._board.drives:
                next_s = now_s + COMMAND_S * self._draw.uniform(0.8, 1.2)
                self._command()
            while ms < 1000.0 * (now_s - begin_s):
                self._millisecond(ms)
                ms += 1
        if until_driven:
            raise MecazenError("the driver has not started; `mecazen hardware probe` says why")

    def _listen(self) -> None:
        ready, _, _ = select.select([self._line.fd], [], [], 0.0002)
        if not ready:
            return
        data = self._line.read()
        now_s = time.monotonic()
        for byte in data:
            self._board.receive(byte)
        for number in _MOTION.findall(data):
            speed = int.from_bytes(number, "little", signed=True)
            self._on_line[speed] = now_s
            if self._commanded is not None and self._commanded[0] == speed:
                self.commands_s.append(now_s - self._commanded[1])
                self._commanded = None

    def _command(self) -> None:
        twist = Twist2D(self._draw.uniform(0.2, 0.9), 0.0, 0.0)
        self._put(Twist.planar(twist), None)

    def _on_command(self, joints: JointState, stamp: Stamp | None) -> None:
        del stamp
        number = round(joints.velocity[0] * RIM_MM)
        if number not in (0, self._last):
            self._last, now_s = number, time.monotonic()
            if now_s - self._on_line.get(number, 0.0) < BEFORE_S:
                self.commands_s.append(0.0)  # the frame arrived before the command was received
            else:
                self._commanded = number, now_s

    def _millisecond(self, ms: int) -> None:
        if ms % STEP_MS == 0:
            self._angle += STEP_RAD
            self._is_sent, self._jumped_s = True, None
        angles = (self._angle,) * 4
        sent = self._board.millisecond(lambda: Instruments(angles))
        if sent[:4] == b"\xff\xfb\x13\x0d" and self._is_sent:
            self._is_sent, self._jumped_s = False, time.monotonic()
        self._line.send(sent)
        while self._line.waiting:
            self._line.millisecond()

    def _on_joints(self, joints: JointState, stamp: Stamp | None) -> None:
        del stamp
        if self._jumped_s is not None and joints.velocity[0] > SEEN_RAD_S:
            self.reports_s.append(time.monotonic() - self._jumped_s)
            self._jumped_s = None


def _of(samples_s: list[float]) -> Latency:
    ordered = sorted(1000.0 * sample for sample in samples_s) or [math.nan]
    at = [ordered[min(int(share * len(ordered)), len(ordered) - 1)] for share in (0.5, 0.99)]
    return Latency(len(samples_s), *(round(value, 2) for value in (*at, ordered[-1])))
