"""Runs an emulated board in real time: a line, the firmware, and the world that it drives."""

from __future__ import annotations

import os
import select
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from mecazen_hardware.emulator.faults import Faults, Requested
from mecazen_hardware.emulator.firmware import Firmware
from mecazen_hardware.emulator.line import BYTES_PER_MS, Line
from mecazen_hardware.emulator.relay import Relay
from mecazen_hardware.emulator.world import TICK_MS, EmulatedWorld

MAX_LAG_MS = 1000
"""Lag up to which the emulator catches up; beyond it, its time falls behind the wall clock [ms]."""
GAP_S = 0.002
"""Minimum time between two frames so that the board receives both [s]."""
PRIORITY = 2
"""Real-time priority, above the driver's: a real board does not compete for the host's
processor."""
JUMP_COUNTS = 5000
BROWN_V = 9.0


class Emulator:
    """An emulated ROSMASTER X3.

    The world starts with the first frame that drives. Until then persons stand still.

    Args:
        line: The line to the host.
        world: The world that the board drives.
        firmware: The board.
        faults: Requested faults.
        relay: Publishes persons and sensors; None to publish nothing.
    """

    def __init__(
        self,
        line: Line,
        world: EmulatedWorld,
        firmware: Firmware,
        faults: Requested,
        relay: Relay | None = None,
    ) -> None:
        self.line, self.world, self.firmware = line, world, firmware
        self.lag_ms = 0
        """Total time by which the emulated world is behind the wall clock [ms]."""
        self.happened: list[str] = []
        """Events that have happened and were not printed yet."""
        self.last_heard_s = 0.0
        """Time of the newest frame since the first that drives [s]."""
        self._relay = relay
        self._to_board = Faults(faults.chances, seed=1)
        self._to_host = Faults(faults.chances, seed=2)
        self._events = sorted(faults.events.items(), key=lambda event: event[1])
        self._delay_ms = round(1000.0 * faults.delay_s)
        self._is_silent = False
        self._ms = self._world_ms = 0
        self._arrived: deque[tuple[int, bytes, tuple[bool, bool]]] = deque()
        """Bytes with the time at which the board receives them [ms], whether there was a gap before
        them, and whether there were gaps between them."""
        self._incoming: deque[tuple[int, bool]] = deque()
        self._outgoing: deque[tuple[int, bytes]] = deque()
        self._room = 0.0
        self._begin_s = self._looked_s = self._earliest_s = time.monotonic()

    @property
    def time_s(self) -> float:
        """Time since the first frame that drives [s]."""
        return self._world_ms / 1000.0

    def run(self, stop: Callable[[], bool]) -> None:
        """Run in real time until `stop` returns true."""
        with suppress(PermissionError):  # as for the other processes of a stack
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))
        self._begin_s = time.monotonic() - self._ms / 1000.0
        while not stop():
            due_ms = int(1000.0 * (time.monotonic() - self._begin_s))
            if due_ms - self._ms > MAX_LAG_MS:
                late_ms = due_ms - self._ms - 1
                self.lag_ms += late_ms
                self._begin_s += late_ms / 1000.0
                due_ms -= late_ms
            while self._ms < due_ms:
                self._look()
                self._millisecond()
            wait_s = max(self._begin_s + (self._ms + 1) / 1000.0 - time.monotonic(), 0.0)
            if not self.line.is_open:
                time.sleep(wait_s)
                continue
            select.select([self.line.fd], [], [], wait_s)
            self._look()

    def _look(self) -> None:
        """Take the bytes that the host has sent since the last call.

        A pseudo-terminal has no times of arrival: bytes came at any time since the last call. The
        emulator assumes a gap between two frames if their possible times allow it.
        """
        now_s, last_s = time.monotonic(), self._looked_s
        self._looked_s = now_s
        if not self.line.is_open or not (data := self.line.read()):
            return
        gaps = now_s - self._earliest_s >= GAP_S, now_s - last_s >= GAP_S
        self._earliest_s = last_s
        # by the wall clock: bytes that arrive while the emulator catches up did not arrive together
        arrived_ms = max(int(1000.0 * (now_s - self._begin_s)), self._ms) + self._delay_ms
        self._arrived.append((arrived_ms, self._to_board.pass_on(data), gaps))

    def _millisecond(self) -> None:
        firmware, world = self.firmware, self.world
        while self._arrived and self._arrived[0][0] <= self._ms:
            _, data, (before, within) = self._arrived.popleft()
            self._incoming.extend((byte, within if n else before) for n, byte in enumerate(data))
        self._room = min(self._room + BYTES_PER_MS, 2 * BYTES_PER_MS)
        while self._incoming and self._room >= 1.0:
            byte, had_gap = self._incoming[0]
            if firmware.is_full and had_gap:
                break
            self._incoming.popleft()
            firmware.receive(byte)
            self._room -= 1.0
        taken = firmware.taken
        sent = firmware.millisecond(world.sense)
        if firmware.taken != taken:
            self.last_heard_s = self.time_s
            if firmware.drives and not world.has_begun:
                world.begin()
        if sent and not self._is_silent:
            self._outgoing.append((self._ms + self._delay_ms, self._to_host.pass_on(sent)))
        while self._outgoing and self._outgoing[0][0] <= self._ms:
            self.line.send(self._outgoing.popleft()[1])
        if self.line.is_open:
            self.line.millisecond()
        self._ms += 1
        if world.has_begun:
            self._world_ms += 1
            self._happen()
            if self._world_ms % TICK_MS == 0:
                world.step(firmware.duty)
                self._publish()

    def _publish(self) -> None:
        if self._relay is not None:
            self._relay.publish(self.world.news, self.world.time_ns)
        self.world.news.clear()

    def _happen(self) -> None:
        while self._events and self._events[0][1] <= self.time_s:
            name, _ = self._events.pop(0)
            self.happened.append(name)
            match name:
                case "silence":
                    self._is_silent = True
                case "unplug":
                    with suppress(OSError):
                        self.line.unplug()
                case "brownout":
                    self.world.battery_v = BROWN_V
                case "jump":
                    self.firmware.jump += JUMP_COUNTS
