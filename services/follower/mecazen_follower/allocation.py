"""Allocates the robot's speed by priority: distance first, then the yaw rate, then the bearing."""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen.drive import Drive
from mecazen.geometry import Twist2D, rotate

Interval = tuple[float, float]
"""From the lowest to the highest value."""
ROUNDING = 1e-12
"""A coefficient below this value is a rounding error."""
WORTHWHILE = 1e-6
"""An axis that converts less than this share of its speed into distance is not used."""
DISTANCE_WEIGHT = 10.0
"""Weight of a squared speed away from the person relative to one around them, in acceleration.

With all the weight on the distance, its noise would leave the bearing no acceleration.
"""
TURN_SHARE = 0.5
"""Share of the rim speed that a turn gets before the distance, if `turn_first` is set."""


class Wanted(NamedTuple):
    """A twist about the person: away from them and around them [m/s], and a yaw rate [rad/s]."""

    away: float
    around: float
    yaw: float
    turn_first: bool = False
    """Whether the yaw rate gets `TURN_SHARE` of the rim speed before the distance."""


class Box(NamedTuple):
    """The velocities that each axis of base_link may have."""

    x: Interval
    y: Interval
    yaw: Interval

    def holds(self, twist: Twist2D) -> bool:
        """Return whether all axes of a twist are within the box."""
        return all(low <= v <= high for v, (low, high) in zip(twist, self, strict=True))


def allocate(
    wanted: Wanted, direction: float, last: Twist2D, drive: Drive, max_speed: float, dt: float
) -> Twist2D:
    """Return the twist in base_link that is as near to `wanted` as the limits allow.

    The target is the best twist within the speed limits, see `_in_order`. The result is the twist
    nearest to the target that the axes can reach in `dt`, with `DISTANCE_WEIGHT`. If the wheels are
    too slow for this twist, its parts are served in the same order.

    Args:
        wanted: The twist that the control law requests.
        direction: Direction from the person to the robot, in base_link [rad].
        last: The previous twist, within the limits.
        drive: The limits of wheels and axes.
        max_speed: Limit of the planar speed [m/s].
        dt: Time since `last` [s].
    """
    free = Box(*((-axis.velocity, axis.velocity) for axis in drive.axes))
    target = _in_order(wanted, direction, free, drive, max_speed)
    near = Box(*(axis.reach(now, dt) for axis, now in zip(drive.axes, last, strict=True)))
    if near.holds(target):
        return target
    away, around = rotate(*_step(target, direction, near), -direction)
    step = Wanted(away, around, _nearest(target.yaw, near.yaw), wanted.turn_first)
    return _in_order(step, direction, near, drive, max_speed)


def _in_order(
    wanted: Wanted, direction: float, box: Box, drive: Drive, max_speed: float
) -> Twist2D:
    """Return the twist within `box` and the wheel limits that serves `wanted` in order.

    First, the part away from the person comes as near as possible to the wanted value. Then the yaw
    rate does, with that part kept; then the part around the person, with both kept. The twists
    within the limits are a convex set, so each part has an interval, in closed form.
    """
    c, s = math.cos(direction), math.sin(direction)
    away, around, yaw, _ = wanted
    twist = Twist2D(c * away - s * around, s * away + c * around, yaw)
    if (
        drive.rims(twist) <= drive.rim_speed
        and math.hypot(away, around) <= max_speed
        and box.holds(twist)
    ):
        return twist

    share = TURN_SHARE * drive.rim_speed / drive.lever if drive.lever > 0.0 else math.inf
    first = _nearest(wanted.yaw, (-share, share)) if wanted.turn_first else 0.0
    rims = drive.rim_speed - drive.lever * abs(_nearest(first, box.yaw))
    most = _farthest(c, s, box, rims, drive.sideways)
    least = -_farthest(-c, -s, box, rims, drive.sideways)
    away = _nearest(wanted.away, (max(least, -max_speed), min(most, max_speed)))

    # v = (c·away - s·around, s·away + c·around), with each axis within the box
    ends = _between([(-s, box.x[1] - c * away), (s, c * away - box.x[0])])
    ends = _common(ends, _between([(c, box.y[1] - s * away), (-c, s * away - box.y[0])]))
    # the lowest rim speed for `away`: at a point where one of the axes does not contribute
    zeros = [part / by for part, by in ((c * away, s), (-s * away, c)) if abs(by) > ROUNDING]
    needed = min(
        abs(c * away - s * around) + drive.sideways * abs(s * away + c * around)
        for around in (_nearest(zero, ends) for zero in zeros)
    )
    spare = max(drive.rim_speed - needed, 0.0)
    fastest = spare / drive.lever if drive.lever > 0.0 else math.inf
    yaw = _nearest(_nearest(wanted.yaw, box.yaw), (-fastest, fastest))

    rims = drive.rim_speed - drive.lever * abs(yaw)
    rows = []
    for front in (1.0, -1.0):
        for side in (drive.sideways, -drive.sideways):
            slope, offset = side * c - front * s, (front * c + side * s) * away
            rows.append((slope, rims - offset))
    rest = math.sqrt(max(max_speed**2 - away**2, 0.0))
    around = _nearest(_nearest(wanted.around, _common(ends, _between(rows))), (-rest, rest))
    return Twist2D(c * away - s * around, s * away + c * around, yaw)


def _step(target: Twist2D, direction: float, box: Box) -> tuple[float, float]:
    """Return the velocity in `box` nearest to that of `target`, with `DISTANCE_WEIGHT`."""
    dx, dy = _nearest(target.x, box.x) - target.x, _nearest(target.y, box.y) - target.y
    c, s, weight = math.cos(direction), math.sin(direction), DISTANCE_WEIGHT
    xx, xy, yy = weight * c * c + s * s, (weight - 1.0) * c * s, weight * s * s + c * c
    # if a side of the box limits one axis, the other axis can compensate
    steps = [(0.0, 0.0)]
    if dx or dy:
        on_x = dx, _nearest(target.y - xy * dx / yy, box.y) - target.y
        on_y = _nearest(target.x - xy * dy / xx, box.x) - target.x, dy
        steps = [step for step, stopped in ((on_x, dx), (on_y, dy)) if stopped]
    x, y = min(steps, key=lambda d: xx * d[0] ** 2 + 2.0 * xy * d[0] * d[1] + yy * d[1] ** 2)
    return target.x + x, target.y + y


def _farthest(c: float, s: float, box: Box, rims: float, sideways: float) -> float:
    """Return the largest c·vx + s·vy in `box` with |vx| + sideways·|vy| <= `rims`.

    The axis that gains more per rim speed is used first, as in the fractional knapsack problem.
    """
    x, y = _nearest(0.0, box.x), _nearest(0.0, box.y)
    left = max(rims - abs(x) - sideways * abs(y), 0.0)
    reached = c * x + s * y
    gains = [
        (abs(c), 1.0, box.x[1] - x if c > 0.0 else x - box.x[0]),
        (abs(s), sideways, box.y[1] - y if s > 0.0 else y - box.y[0]),
    ]
    for gain, cost, room in sorted(gains, key=lambda one: one[0] / one[1], reverse=True):
        if gain > WORTHWHILE:
            step = min(room, left / cost)
            reached += gain * step
            left -= cost * step
    return reached


def _between(rows: list[tuple[float, float]]) -> Interval:
    """Return the interval of all q with slope·q <= bound for each row (slope, bound)."""
    low = max((bound / slope for slope, bound in rows if slope < -ROUNDING), default=-math.inf)
    high = min((bound / slope for slope, bound in rows if slope > ROUNDING), default=math.inf)
    return low, high


def _common(one: Interval, other: Interval) -> Interval:
    """Return the intersection of two intervals; a point of `one` if rounding separates them."""
    low, high = max(one[0], other[0]), min(one[1], other[1])
    return (low, high) if low <= high else (_nearest(low, one),) * 2


def _nearest(value: float, interval: Interval) -> float:
    """Return the value in an interval that is nearest to `value`."""
    return min(max(value, interval[0]), interval[1])
