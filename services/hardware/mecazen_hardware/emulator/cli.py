"""The command `mecazen hardware emulate`: runs the emulator and prints events."""

from __future__ import annotations

import math
import signal
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from mecazen_hardware.emulator.emulator import Emulator
from mecazen_hardware.emulator.faults import parse_faults
from mecazen_hardware.emulator.firmware import Firmware
from mecazen_hardware.emulator.line import Line
from mecazen_hardware.emulator.relay import Relay
from mecazen_hardware.emulator.world import EmulatedWorld, load

RUNAWAY_S = 1.0
"""Silence of the host after which driven wheels count as a run-away [s]."""


def emulate(
    path: Path,
    settings: Sequence[str],
    link: Path,
    faults: Sequence[str],
    duration_s: float | None,
) -> None:
    """Emulate the board until a signal, or for `duration_s` [s].

    Raises:
        MecazenError: A setting, a fault or the path of the link can't be used.
    """
    requested = parse_faults(faults)
    scenario = load(path, settings)
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, _: stopped.append(number))
    with (
        closing(Line(link)) as line,
        closing(EmulatedWorld(scenario)) as world,
        closing(Relay(scenario.bus)) as relay,
    ):
        emulator = Emulator(line, world, Firmware(), requested, relay)
        _say(f"rosmaster_x3 at {link} ({line.name}); the world waits for a frame that drives")
        warned = [False]

        def stop() -> bool:
            _warn(emulator, warned)
            return bool(stopped) or emulator.time_s >= (duration_s or math.inf)

        emulator.run(stop)
        _summarize(emulator)


def _warn(emulator: Emulator, warned: list[bool]) -> None:
    """Print each event of the board once."""
    while emulator.happened:
        _say(f"at {emulator.time_s:.1f} s: {emulator.happened.pop(0)}")
    silent_s = emulator.time_s - emulator.last_heard_s
    is_runaway = silent_s > RUNAWAY_S and any(emulator.firmware.goal)
    if is_runaway and not warned[0]:
        goal = ", ".join(f"{speed:.0f}" for speed in emulator.firmware.goal)
        _say(
            f"at {emulator.time_s:.1f} s: run-away: no frame for {silent_s:.1f} s, and the motors "
            f"keep their last command ({goal} mm/s); a real board does so for ever"
        )
    warned[0] = is_runaway


def _summarize(emulator: Emulator) -> None:
    firmware, scores = emulator.firmware, emulator.world.scores()
    _say(
        f"{emulator.time_s:.1f} s: {firmware.taken} frames taken, {firmware.lost} lost; "
        f"{emulator.lag_ms} ms behind the wall clock"
    )
    if scores.d_err_m is not None:
        _say(f"distance error {scores.d_err_m:.4f} m, heading error {scores.theta_err_deg:.2f}°")


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()
