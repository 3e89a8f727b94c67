"""Social forces in the variant of Follow-Bench: a drive to the way-point, and repulsions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from mecazen_experiments.followbench.pedestrians import STEP_S

DRIVE_HZ = 1.5
PEOPLE_M_S2, PEOPLE_M = 7.0, 0.3
"""Strength and range of the repulsion by others."""
WALL_M_S2, WALL_M = 5.0, 0.25
"""Strength and range of the repulsion by the nearest obstacle."""
REACHED_M = 0.8
"""Distance below which the way-point no longer attracts."""


def velocity(
    place: tuple[float, float],
    now: tuple[float, float],
    goal: tuple[float, float],
    others: Iterable[Sequence[float]],
    wall: tuple[float, float, float],
    safe: float,
    fastest: float,
) -> tuple[float, float]:
    """Return the velocity after a step [m/s].

    Args:
        place: The walker's place [m].
        now: The walker's velocity [m/s].
        goal: The next way-point [m].
        others: x, y and velocity of each of the others [m, m/s].
        wall: Unit vector away from the nearest obstacle, and its distance [m].
        safe: Distance at which the repulsion by others is `PEOPLE_M_S2` [m].
        fastest: Maximum speed [m/s].
    """
    (x, y), (vx, vy) = place, now
    gx, gy = goal[0] - x, goal[1] - y
    distance = math.sqrt(gx * gx + gy * gy)
    drive = fastest / distance if distance > REACHED_M else 0.0
    ax, ay = DRIVE_HZ * (drive * gx - vx), DRIVE_HZ * (drive * gy - vy)
    for px, py, _, _ in others:
        dx, dy = x - px, y - py
        apart = max(math.sqrt(dx * dx + dy * dy), 1e-9)
        push = PEOPLE_M_S2 * math.exp((safe - apart) / PEOPLE_M) / apart
        ax, ay = ax + push * dx, ay + push * dy
    push = WALL_M_S2 * math.exp((0.5 * safe - wall[2]) / WALL_M)
    ax, ay = ax + push * wall[0], ay + push * wall[1]
    vx, vy = vx + STEP_S * ax, vy + STEP_S * ay
    speed = math.sqrt(vx * vx + vy * vy)
    if speed > fastest:
        return vx * fastest / speed, vy * fastest / speed
    return vx, vy
