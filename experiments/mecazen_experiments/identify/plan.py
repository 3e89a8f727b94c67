"""The excitation: a minute of commands that makes all parameters of a robot observable."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from mecazen.config import ControllerConfig

HOLD_S = 0.75
"""Duration of a step: several time constants of a motor."""
AHEAD_S = 1.5
"""Duration of a step straight ahead, from whose steady part friction is found."""
FASTEST = 0.5, 0.5, 1.5
"""Highest speeds [m/s, m/s, rad/s], if the limits of the controller allow them."""
LEVELS = 1.0, -1.0, 0.5, -0.5, 0.25, -0.25, 0.1, -0.1
"""Speeds along an axis, as shares of the highest: in both directions, so that the robot returns."""
MIXED = 0.4
"""Speeds along several axes at once, as a share of the highest."""
DIRECTIONS = ((1, 1, 0), (1, -1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1), (1, -1, 1))
Levels = tuple[float, float, float]


class Step(NamedTuple):
    """A command that holds until the next step."""

    time_s: float
    vx_m_s: float
    vy_m_s: float
    wz_rad_s: float


def plan(config: ControllerConfig) -> list[Step]:
    """Return the excitation of a robot within the limits of its controller."""
    of = config.limits
    allowed = of.x.max_velocity_m_s, of.y.max_velocity_m_s, of.yaw.max_velocity_rad_s
    fastest = [min(pair) for pair in zip(allowed, FASTEST, strict=True)]
    steps, time_s = [], 0.0
    for duration, levels in _levels():
        vx, vy, wz = (level * most for level, most in zip(levels, fastest, strict=True))
        steps.append(Step(time_s, vx, vy, wz))
        time_s += duration
    return [*steps, Step(time_s, 0.0, 0.0, 0.0)]


def _levels() -> Iterator[tuple[float, Levels]]:
    """Yield the duration [s] and the levels of each step."""
    for _ in range(2):
        yield from ((AHEAD_S, (level, 0.0, 0.0)) for level in LEVELS)
        yield from ((HOLD_S, (0.0, level, 0.0)) for level in LEVELS)
        yield from ((HOLD_S, (0.0, 0.0, level)) for level in LEVELS)
    for x, y, yaw in DIRECTIONS:
        for sign in (MIXED, -MIXED):
            yield HOLD_S, (sign * x, sign * y, sign * yaw)


def csv(steps: list[Step]) -> str:
    """Return a plan as CSV."""
    rows = [",".join(Step._fields), *(",".join(f"{value:g}" for value in step) for step in steps)]
    return "\n".join(rows) + "\n"
