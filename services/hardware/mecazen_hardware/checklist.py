"""The checklist before the first run: each wheel in turn, off the ground."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

from mecazen.robot import WHEELS

from mecazen_hardware.board import WheelAngles
from mecazen_hardware.link import Link
from mecazen_hardware.wheels import WheelEstimator

SHARE = 0.1
"""Share of a motor's full power at which a wheel turns; the X3's board adds 44 % of full power."""
TURN_S, REST_S, REPEAT_S = 1.0, 0.5, 0.03
LEAST_RAD = 0.5
"""Minimum angle by which a wheel counts as turned [rad]."""


class WheelCheck(NamedTuple):
    """The motion of all wheels while one of them was commanded to turn forward."""

    number: int
    """The number of that wheel in the order of `WHEELS`."""
    angles: tuple[float, ...]
    """Angles by which all wheels turned [rad], in the order of `WHEELS`."""

    @property
    def problem(self) -> str:
        """The mistake, in words; empty if there is none."""
        turned = [wheel for wheel in range(len(WHEELS)) if abs(self.angles[wheel]) >= LEAST_RAD]
        if not turned:
            return "no wheel turned: is the motor plugged in, and the battery charged?"
        most = max(turned, key=lambda wheel: abs(self.angles[wheel]))
        if most != self.number:
            return f"{WHEELS[most]} turned instead: the plugs of the two motors are swapped"
        if self.angles[most] < 0.0:
            return "it counts backwards: the wires of its motor or of its encoder are swapped"
        also = ", ".join(WHEELS[wheel] for wheel in turned if wheel != most)
        return f"{also} turned as well: is the robot off the ground?" if also else ""


def turn_each(link: Link, max_speed: float, show: Callable[[str], None]) -> list[WheelCheck]:
    """Turn each wheel alone, forward for a second; return the angles that the encoders measured.

    `max_speed` is that of the wheels [rad/s]; `show` prints a line about the next step.
    """
    wheels, checks = WheelEstimator(link.board.CYCLE_S, max_speed), []
    for number, name in enumerate(WHEELS):
        show(f"{name} turns forward")
        _wait(link, wheels, REST_S)
        before = wheels.angles
        _wait(link, wheels, TURN_S, number)
        link.stop()
        _wait(link, wheels, REST_S)
        angles = (end - begin for end, begin in zip(wheels.angles, before, strict=True))
        checks.append(WheelCheck(number, tuple(angles)))
    return checks


def _wait(
    link: Link, wheels: WheelEstimator, duration_s: float, turning: int | None = None
) -> None:
    """Read the wheels' reports for some time, and turn a wheel during that time."""
    begin_s = last_s = time.monotonic()
    while last_s - begin_s < duration_s:
        if turning is not None:
            link.turn_wheel(turning, SHARE)
        time.sleep(REPEAT_S)
        now_s = time.monotonic()
        for report, arrived_s in link.read():
            if isinstance(report, WheelAngles):
                wheels.take(report, arrived_s)
        wheels.advance(now_s, now_s - last_s)
        last_s = now_s
