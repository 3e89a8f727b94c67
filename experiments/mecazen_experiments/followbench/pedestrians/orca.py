"""ORCA in the variant of Follow-Bench: velocities that do half of each avoidance.

J. van den Berg, S. J. Guy, M. Lin & D. Manocha, Reciprocal n-body collision avoidance, Robotics
Research, 2011. In this variant only the walker's own radius counts, all others are neighbours, and
blocked cells of the grid have lines of their own. The horizon is 1 s, or one step for others who
are nearer than the radius.

Plain numbers are four times as fast as arrays for the twenty lines of a walker.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from mecazen_experiments.followbench.pedestrians import STEP_S

PARALLEL = 1e-6
"""Sine below which two lines count as parallel."""

Vector = tuple[float, float]
Line = tuple[float, float, float, float]
"""A half-plane of permitted velocities, on the left of a line: the line's direction (a unit vector)
and a velocity on it [m/s]."""


def velocity(
    place: Vector,
    now: Vector,
    wanted: Vector,
    others: Iterable[Sequence[float]],
    cells: Iterable[Sequence[float]],
    radius: float,
    fastest: float,
) -> Vector:
    """Return the permitted velocity that is nearest to the wanted one [m/s].

    Args:
        place: The walker's place [m].
        now: The walker's velocity [m/s].
        wanted: The wanted velocity [m/s].
        others: x, y and velocity of each of the others [m, m/s].
        cells: x and y of blocked cells near by [m].
        radius: Distance to be kept between centres [m].
        fastest: Maximum speed [m/s].
    """
    (x, y), (vx, vy) = place, now
    apart = [(px - x, py - y, vx - ux, vy - uy) for px, py, ux, uy in others]
    apart.sort(key=_squared)
    lines = [line(one, now, radius, 0.5) for one in apart]
    fixed = [(px - x, py - y, vx, vy) for px, py in cells]
    # as in Follow-Bench, a cell nearer than the radius has no line
    lines += [line(one, now, radius, 1.0) for one in fixed if _squared(one) > radius * radius]
    failed, chosen = _nearest(lines, wanted, fastest)
    if failed < len(lines):
        chosen = _least_bad(lines, failed, len(fixed), chosen, fastest)
    return chosen


def _squared(one: Line) -> float:
    return one[0] * one[0] + one[1] * one[1]


def line(other: Line, now: Vector, radius: float, share: float) -> Line:
    """Return the line (half-plane) of velocities that avoid another.

    Args:
        other: Vector from the walker to the other [m], and the walker's velocity minus theirs.
        now: The walker's velocity [m/s].
        radius: Distance to be kept [m].
        share: Part of the change of velocity that the walker makes.
    """
    px, py, vx, vy = other
    squared = px * px + py * py
    far = squared > radius * radius
    rate = 1.0 if far else 1.0 / STEP_S
    wx, wy = vx - rate * px, vy - rate * py
    length = max(math.sqrt(wx * wx + wy * wy), 1e-12)
    dot = wx * px + wy * py
    if not far or (dot < 0.0 and -dot > radius * length):
        # the nearest edge of the forbidden velocities is their round end
        dx, dy = wy / length, -wx / length
        excess = radius * rate - length
        ux, uy = -excess * dy, excess * dx
    else:
        leg = math.sqrt(squared - radius * radius)
        side = 1.0 if px * wy - wx * py > 0.0 else -1.0
        dx = (side * px * leg - py * radius) / squared
        dy = (px * radius + side * py * leg) / squared
        along = vx * dx + vy * dy
        ux, uy = along * dx - vx, along * dy - vy
    return dx, dy, now[0] + share * ux, now[1] + share * uy


def _nearest(
    lines: Sequence[Line], wanted: Vector, fastest: float, *, is_way: bool = False
) -> tuple[int, Vector]:
    """Return the number of the first line that can't be met, and the best velocity.

    The velocity meets all lines before that line. If all lines are met, the number is their count.

    Args:
        lines: The lines, one after the other.
        wanted: The velocity to come near to, or the direction to go in.
        fastest: Maximum speed [m/s].
        is_way: Whether `wanted` is a direction in which to go as far as possible.
    """
    x, y = wanted
    if is_way:
        x, y = x * fastest, y * fastest
    elif x * x + y * y > fastest * fastest:
        speed = math.sqrt(x * x + y * y)
        x, y = x / speed * fastest, y / speed * fastest
    for number, (dx, dy, px, py) in enumerate(lines):
        if dx * (py - y) - (px - x) * dy > 0.0:
            found = _on_line(lines, number, wanted, fastest, is_way=is_way)
            if found is None:
                return number, (x, y)
            x, y = found
    return len(lines), (x, y)


def _on_line(
    lines: Sequence[Line], number: int, wanted: Vector, fastest: float, *, is_way: bool
) -> Vector | None:
    """Return the best velocity on a line that all lines before it permit; None: there is none."""
    dx, dy, px, py = lines[number]
    dot = px * dx + py * dy
    room = dot * dot + fastest * fastest - (px * px + py * py)
    if room < 0.0:
        return None
    low, high = -dot - math.sqrt(room), -dot + math.sqrt(room)
    for ex, ey, qx, qy in lines[:number]:
        denominator = dx * ey - ex * dy
        numerator = ex * (py - qy) - (px - qx) * ey
        if abs(denominator) <= PARALLEL:
            if numerator < 0.0:
                return None
            continue
        t = numerator / denominator
        if denominator > 0.0:
            high = min(high, t)
        else:
            low = max(low, t)
        if low > high:
            return None
    wx, wy = wanted
    if is_way:
        best = high if wx * dx + wy * dy > 0.0 else low
    else:
        best = min(max(dx * (wx - px) + dy * (wy - py), low), high)
    return px + best * dx, py + best * dy


def _least_bad(
    lines: Sequence[Line], failed: int, skipped: int, velocity: Vector, fastest: float
) -> Vector:
    """Return the velocity that violates the lines least, beginning with the line `failed`.

    As in Follow-Bench, the first `skipped` lines, as many as there are cells, are left out.
    """
    worst, (x, y) = 0.0, velocity
    for number in range(failed, len(lines)):
        dx, dy, px, py = lines[number]
        if dx * (py - y) - (px - x) * dy <= worst:
            continue
        between = []
        for ex, ey, qx, qy in lines[skipped:number]:
            determinant = dx * ey - ex * dy
            if abs(determinant) > PARALLEL:
                t = (ex * (py - qy) - (px - qx) * ey) / determinant
                point = px + t * dx, py + t * dy
            elif dx * ex + dy * ey > 0.0:
                continue
            else:
                point = 0.5 * (px + qx), 0.5 * (py + qy)
            tx, ty = ex - dx, ey - dy
            length = max(math.sqrt(tx * tx + ty * ty), 1e-12)
            between.append((tx / length, ty / length, *point))
        _, (x, y) = _nearest(between, (-dy, dx), fastest, is_way=True)
        worst = dx * (py - y) - (px - x) * dy
    return x, y
