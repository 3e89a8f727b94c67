"""The checklist before the first run: each wheel in turn, off the ground."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

from mecazen.robot import WHEELS

from mecazen_hardware.board import WheelAngles
from mecazen_hardware.link import HardwareError, Link

SHARE = 0.1
"""Share of a motor's full power at which a wheel turns; the X3's board adds 44 % of full power."""
TURN_S, REST_S, REPEAT_S = 1.0, 0.5, 0.03
LEAST_RAD = 0.5
"""Minimum angle by which a wheel counts as turned [rad]."""


def turn_each(link: Link, show: Callable[[str], None]) -> list[tuple[float, ...]]:
    """Turn each wheel alone, forward for a second; return the angles of all wheels each time [rad].

    `show` prints a line about the next step.

    Raises:
        HardwareError: The board sends no report of the wheels, or the port has gone.
    """
    turned = []
    for wheel, name in enumerate(WHEELS):
        show(f"{name} turns forward")
        before = _wait(link, REST_S)
        _wait(link, TURN_S, wheel)
        link.stop()
        after = _wait(link, REST_S)
        pairs = zip(after.angles, before.angles, strict=True)
        turned.append(tuple(math.remainder(end - begin, after.span) for end, begin in pairs))
    return turned


def _wait(link: Link, duration_s: float, turning: int | None = None) -> WheelAngles:
    """Turn a wheel, if any, for some time; return the newest report of the wheels."""
    newest, end_s = None, time.monotonic() + duration_s
    while time.monotonic() < end_s:
        if turning is not None:
            link.turn_wheel(turning, SHARE)
        time.sleep(REPEAT_S)
        for report, _ in link.read():
            if isinstance(report, WheelAngles):
                newest = report
    if newest is None:
        raise HardwareError(
            f"{link.port.name}: the board has fallen silent: is its cable loose? If a wheel still "
            "turns, switch the robot off"
        )
    return newest


def wiring_problem(commanded: int, turned: Sequence[float]) -> str:
    """Return the mistake, in words, if the wheels turned by `turned` [rad]; empty if there is none.

    The wheels are in the order of `WHEELS`; the one with the number `commanded` should have turned.
    """
    moving = [wheel for wheel in range(len(WHEELS)) if abs(turned[wheel]) >= LEAST_RAD]
    if not moving:
        return "no wheel turned: is the motor plugged in, and the battery charged?"
    most = max(moving, key=lambda wheel: abs(turned[wheel]))
    if most != commanded:
        return f"{WHEELS[most]} turned instead: the plugs of the two motors are swapped"
    if turned[most] < 0.0:
        return "it counts backwards: the wires of its motor or of its encoder are swapped"
    also = ", ".join(WHEELS[wheel] for wheel in moving if wheel != most)
    return f"{also} turned as well: is the robot off the ground?" if also else ""
