"""Limits of velocity, acceleration, deceleration and jerk of one axis, in discrete time."""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen.drive import Limits
from mecazen.geometry import Twist2D

ROUNDING = 1e-9
"""Relative excess of a limit that is taken for rounding when a reference is met."""


class LimiterState(NamedTuple):
    """Velocity of one axis, and the acceleration over the tick that led to it."""

    velocity: float = 0.0
    acceleration: float = 0.0


def limit(state: LimiterState, reference: float, limits: Limits, dt: float) -> LimiterState:
    """Return the state one tick of `dt` [s] after `state`, on the way to `reference`.

    It approaches the reference as fast as the limits allow, meets it exactly without
    overshoot and then holds it. Only a reference that moves while the axis accelerates can
    be passed, by what the jerk limit makes unavoidable. Limits hold for differences over a
    tick: of velocity for acceleration, of acceleration for jerk.

    The argument: with steps of jerk q = jerk * dt, an acceleration a > 0 let off in the
    steps a, a - q, a - 2q, ... still adds S(a) = dt * (a + (a - q) + ...) to the velocity.
    The largest a with S(a) within what is missing is taken; then a - q is in the same way
    right for the next tick, so every plan can be carried through to its end.

    Where acceleration and deceleration have different limits, a reversal goes through a
    tick at rest: the limit changes there, and the way to rest never needs the other one.
    """
    velocity, acceleration = state
    aim = min(max(reference, -limits.velocity), limits.velocity)
    reverses = velocity < 0.0 < aim or aim < 0.0 < velocity
    if reverses and limits.acceleration != limits.deceleration:
        aim = 0.0

    rise = limits.deceleration if velocity < 0.0 else limits.acceleration
    fall = limits.deceleration if velocity > 0.0 else limits.acceleration
    step = limits.jerk * dt
    missing = aim - velocity

    # In one tick, if the acceleration that this takes can be let off in the next.
    needed = missing / dt
    slack = 1.0 + ROUNDING
    if (
        -min(fall, step) * slack <= needed <= min(rise, step) * slack
        and abs(needed - acceleration) <= step * slack
    ):
        return LimiterState(aim, needed)

    wanted = math.copysign(_let_off(abs(missing), step, dt), missing)
    wanted = min(max(wanted, -fall), rise)
    wanted = min(max(wanted, acceleration - step), acceleration + step)
    return LimiterState(velocity + wanted * dt, wanted)


def limit_twist(
    state: tuple[LimiterState, LimiterState, LimiterState],
    reference: Twist2D,
    limits: tuple[Limits, Limits, Limits],
    dt: float,
) -> tuple[LimiterState, LimiterState, LimiterState]:
    """Return `limit` of each axis: x, y, yaw."""
    x, y, yaw = (limit(*axis, dt) for axis in zip(state, reference, limits, strict=True))
    return x, y, yaw


def _let_off(missing: float, step: float, dt: float) -> float:
    """Return the largest a >= 0 with S(a) <= `missing`: see `limit`."""
    if math.isinf(step):
        return missing / dt
    # In n steps, (n - 1) step < a <= n step, S(a) = dt * (n a - step n (n - 1) / 2).
    n = max(1, math.ceil((math.sqrt(1.0 + 8.0 * missing / (dt * step)) - 1.0) / 2.0))
    return (missing / dt + step * n * (n - 1) / 2.0) / n
