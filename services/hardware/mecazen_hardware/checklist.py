"""The checklist before the first run: each wheel in turn, off the ground."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

from mecazen.robot import WHEELS

from mecazen_hardware import keeper
from mecazen_hardware.board import MeasuredSpeeds, Report, WheelAngles
from mecazen_hardware.link import Link
from mecazen_hardware.wheels import Wheels

SHARE = 0.1
"""Share of a motor's full power at which a wheel turns; the X3's board adds 44 % of full power."""
TURN_S, REST_S, REPEAT_S = 1.0, 0.5, 0.03
LEAST_RAD = 0.5
"""Minimum angle by which a wheel counts as turned [rad]."""


class Found(NamedTuple):
    """The motion of all wheels while one of them was commanded to turn forward."""

    wheel: str
    turned: tuple[float, ...]
    """Angles by which all wheels turned [rad], in the order of `WHEELS`."""

    @property
    def problem(self) -> str:
        """The mistake, in words; empty if there is none."""
        own = WHEELS.index(self.wheel)
        most = max(range(len(WHEELS)), key=lambda wheel: abs(self.turned[wheel]))
        if abs(self.turned[most]) < LEAST_RAD:
            return "no wheel turned: is the motor plugged in, and the battery charged?"
        if most != own:
            return f"{WHEELS[most]} turned instead: the plugs of the two motors are swapped"
        if self.turned[own] < 0.0:
            return "it counts backwards: the wires of its motor or of its encoder are swapped"
        others = [wheel for wheel in range(len(WHEELS)) if wheel != own]
        also = [WHEELS[wheel] for wheel in others if abs(self.turned[wheel]) >= LEAST_RAD]
        return f"{', '.join(also)} turned as well: is the robot off the ground?" if also else ""


def turn_each(link: Link, max_speed: float, told: Callable[[str], None]) -> list[Found]:
    """Turn each wheel alone, forward for a second; return the angles that the encoders measured.

    Args:
        link: The link to a board that answers.
        max_speed: Highest speed of the wheels [rad/s].
        told: Function that prints a line about the next step.

    Raises:
        HardwareError: The port has gone.
    """
    wheels, found = Wheels(link.board.CYCLE_S, max_speed), []
    for number, name in enumerate(WHEELS):
        told(f"{name} turns forward")
        _wait(link, wheels, REST_S)
        before = wheels.angles
        _wait(link, wheels, TURN_S, link.board.turn_one(number, SHARE))
        link.stop()
        _wait(link, wheels, REST_S)
        turned = (after - then for after, then in zip(wheels.angles, before, strict=True))
        found.append(Found(name, tuple(turned)))
    return found


def _wait(link: Link, wheels: Wheels, duration_s: float, frame: bytes = b"") -> None:
    """Read the wheels' reports for some time, and repeat a frame during that time."""
    begin_s = last_s = time.monotonic()
    while last_s - begin_s < duration_s:
        if frame:
            link.ask(frame, keeper.DRIVE)
        link.poll()
        time.sleep(REPEAT_S)
        now_s = time.monotonic()
        for report, arrived_s in link.read():
            if isinstance(report, WheelAngles | MeasuredSpeeds):
                wheels.take(report, arrived_s)
        wheels.advance(now_s, now_s - last_s)
        last_s = now_s


def rates(reports: Sequence[tuple[Report, float]]) -> dict[str, float]:
    """Return the rate of each kind of report [Hz]."""
    arrivals: dict[str, list[float]] = {}
    for report, arrived_s in reports:
        arrivals.setdefault(type(report).__name__, []).append(arrived_s)
    return {
        kind: (len(times) - 1) / (times[-1] - times[0]) if times[-1] > times[0] else math.nan
        for kind, times in arrivals.items()
    }
