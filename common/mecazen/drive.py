"""How the robot can move: the limits of wheels and controller, and its twist one tick later.

Twists are numbers for one robot, and arrays (3, n) for n robots or plans: x, y [m/s] and yaw rate
[rad/s] in base_link. Results are bit-identical.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from mecazen.config import Scenario
from mecazen.config.services import AngularLimits, AxisLimits, LinearLimits
from mecazen.geometry import Twist2D

ROUNDING = 1e-9
"""Relative excess over a limit that counts as rounding when an axis reaches its reference."""
UNLIMITED = 1e9
"""Value in arrays for the speed of a rim or the acceleration of an axis without a limit."""

Array = npt.NDArray[Any]
"""Double precision for few twists, single precision for many."""


@dataclass(frozen=True)
class Limits:
    """Limits of one axis [m or rad per s, s² and s³]; infinite: no limit.

    Acceleration is a growing speed, deceleration a falling one, in either direction. The lowest
    velocity is the opposite of the highest, unless `min_velocity` is given.
    """

    velocity: float = math.inf
    acceleration: float = math.inf
    deceleration: float = math.inf
    jerk: float = math.inf
    min_velocity: float | None = None

    @property
    def lowest(self) -> float:
        """The lowest velocity, at most 0."""
        return -self.velocity if self.min_velocity is None else self.min_velocity

    def reach(self, velocity: float, dt: float) -> tuple[float, float]:
        """Return the lowest and the highest velocity after `dt` [s], without the jerk limit."""
        up, down = self.acceleration * dt, self.deceleration * dt
        low = velocity - up if velocity <= 0.0 else -_turned(-velocity, up, down)
        high = velocity + up if velocity >= 0.0 else _turned(velocity, up, down)
        return max(low, self.lowest), min(high, self.velocity)


def _turned(velocity: float, up: float, down: float) -> float:
    """Return the highest velocity that an axis reaches from a velocity below 0, also past rest.

    `up` and `down` are the changes of velocity in the whole time at the limits of acceleration and
    of deceleration.
    """
    left = 1.0 + velocity / down
    return left * up if left > 0.0 and up != down else velocity + down


def axis_limits(limits: AxisLimits) -> tuple[Limits, Limits, Limits]:
    """Return the limits of x, y and yaw as numbers."""

    def numbers(axis: LinearLimits | AngularLimits) -> Limits:
        velocity, acceleration, deceleration, jerk, lowest = msgspec.structs.astuple(axis)
        return Limits(velocity, acceleration, deceleration or acceleration, jerk, lowest)

    return numbers(limits.x), numbers(limits.y), numbers(limits.yaw)


class LimiterState(NamedTuple):
    """Velocity of one axis, and the acceleration over the tick that led to it."""

    velocity: float = 0.0
    acceleration: float = 0.0


LimiterStates = tuple[LimiterState, LimiterState, LimiterState]
"""States of the axes x, y and yaw."""


def limit(state: LimiterState, reference: float, limits: Limits, dt: float) -> LimiterState:
    """Return the state one tick of `dt` [s] after `state`, on the way to `reference`.

    The axis approaches the reference as fast as the limits allow, meets it exactly without
    overshoot and then holds it. The axis can pass the reference only if the reference moves while
    the axis accelerates, by an amount that the jerk limit makes unavoidable. Limits hold for
    differences over a tick: of velocity for acceleration, of acceleration for jerk.

    Reason: an acceleration a > 0 that falls to 0 in steps of q = jerk * dt (a, a - q, a - 2q, ...)
    still adds S(a) = dt * (a + (a - q) + ...) to the velocity.
    The limiter takes the largest a with S(a) at most the missing velocity. Then a - q satisfies
    the same condition in the next tick, so every plan can be completed.

    If the limits of acceleration and deceleration differ, a reversal includes a tick at rest. The
    limit changes at that tick, so the way to rest never uses the limit of acceleration.
    """
    velocity, acceleration = state
    aim = min(max(reference, limits.lowest), limits.velocity)
    reverses = velocity < 0.0 < aim or aim < 0.0 < velocity
    if reverses and limits.acceleration != limits.deceleration:
        aim = 0.0

    rise = limits.deceleration if velocity < 0.0 else limits.acceleration
    fall = limits.deceleration if velocity > 0.0 else limits.acceleration
    step = limits.jerk * dt
    missing = aim - velocity

    # Reach the aim in one tick, if the needed acceleration can fall to 0 in the next tick.
    needed = missing / dt
    slack = 1.0 + ROUNDING
    if (
        -min(fall, step) * dt * slack <= missing <= min(rise, step) * dt * slack
        and abs(needed - acceleration) <= step * slack
    ):
        return LimiterState(aim, needed)

    wanted = math.copysign(_let_off(abs(missing), step, dt), missing)
    wanted = min(max(wanted, -fall), rise)
    wanted = min(max(wanted, acceleration - step), acceleration + step)
    return LimiterState(velocity + wanted * dt, wanted)


def _let_off(missing: float, step: float, dt: float) -> float:
    """Return the largest a >= 0 with S(a) <= `missing`: see `limit`."""
    if math.isinf(step):
        return missing / dt
    # In n steps, (n - 1) step < a <= n step, S(a) = dt * (n a - step n (n - 1) / 2).
    n = max(1, math.ceil((math.sqrt(1.0 + 8.0 * missing / (dt * step)) - 1.0) / 2.0))
    return (missing / dt + step * n * (n - 1) / 2.0) / n


class Drive(NamedTuple):
    """The twists (vx, vy, ω) that wheels and controller can follow.

    The wheels can follow a twist if |vx| + sideways·|vy| + lever·|ω| <= rim_speed: the left side is
    the speed of the fastest rim, or its bound if base_link is not at the wheels' centre. Without
    arguments nothing is limited.
    """

    rim_speed: float = math.inf
    """Maximum speed of the wheels' rims [m/s]."""
    sideways: float = 1.0
    """Speed of a rim per speed along y; 1 with rollers at 45°."""
    lever: float = 0.0
    """Speed of the fastest rim per yaw rate [m]."""
    axes: tuple[Limits, Limits, Limits] = (Limits(), Limits(), Limits())
    """The controller's limits of x, y and yaw."""

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Drive:
        """Return the limits of a scenario's robot: its wheels', and those of its controller."""
        wheels, robot = scenario.robot.wheels, scenario.robot
        rim_speed = wheels.max_speed_rad_s * wheels.radius_m
        gains = abs(robot.cross_gain), abs(robot.lever) + robot.swing
        return cls(rim_speed, *gains, axis_limits(scenario.controller.limits))

    def rims(self, twist: Twist2D) -> float:
        """Return the speed of the fastest rim [m/s]."""
        return abs(twist.x) + self.sideways * abs(twist.y) + self.lever * abs(twist.yaw)

    def slowed(self, twist: Twist2D) -> Twist2D:
        """Return a twist with all axes slowed down alike, until no rim is above `rim_speed`."""
        rims = self.rims(twist)
        if rims <= self.rim_speed:
            return twist
        share = self.rim_speed / rims
        return Twist2D(twist.x * share, twist.y * share, twist.yaw * share)

    def is_slower(self, max_speed: float) -> bool:
        """Return whether the wheels are slower than a planar speed [m/s] in every direction."""
        return self.rim_speed / min(self.sideways, 1.0) <= max_speed

    def limited(self, state: LimiterStates, wanted: Twist2D, dt: float) -> LimiterStates:
        """Return the motion `dt` [s] after `state`, on the way to `wanted`: see `limit`.

        `wanted` is slowed down to the limit of the wheels, so its direction is kept. The reached
        twist is also slowed down, and the next tick begins with it, so that a robot at its limit
        brakes at once.
        """
        if self.rims(wanted) > self.rim_speed:
            goal = (
                min(max(v, axis.lowest), axis.velocity)
                for v, axis in zip(wanted, self.axes, strict=True)
            )
            wanted = self.slowed(Twist2D(*goal))
        x, y, yaw = (limit(*axis, dt) for axis in zip(state, wanted, self.axes, strict=True))
        twist = Twist2D(x.velocity, y.velocity, yaw.velocity)
        slowed = self.slowed(twist)
        if slowed is twist:
            return x, y, yaw
        x, y, yaw = (
            LimiterState(velocity, (velocity - before.velocity) / dt)
            for velocity, before in zip(slowed, state, strict=True)
        )
        return x, y, yaw

    def step(self, twist: Twist2D, wanted: Twist2D, max_speed: float, dt: float) -> Twist2D:
        """Return the twist `dt` [s] after `twist`, on the way to `wanted`, without the jerk limit.

        The axes keep their limits, then the wheels slow the robot down, and `max_speed` [m/s]
        limits the planar speed.
        """
        ends = (axis.reach(now, dt) for axis, now in zip(self.axes, twist, strict=True))
        x, y, yaw = (min(max(v, low), high) for v, (low, high) in zip(wanted, ends, strict=True))
        reached = self.slowed(Twist2D(x, y, yaw))
        speed = math.sqrt(reached.x * reached.x + reached.y * reached.y)
        if self.is_slower(max_speed) or speed <= max_speed:
            return reached
        share = max_speed / speed
        return Twist2D(reached.x * share, reached.y * share, reached.yaw)


def bounds(twist: Array, up: Array, down: Array) -> tuple[Array, Array]:
    """Return the lowest and highest twists that the axes reach: `Limits.reach` without `velocity`.

    `up` and `down` are the changes of each axis over the step while its speed grows and falls.
    """
    if up is down:
        return twist - up, twist + up
    size = np.abs(twist)
    left = 1.0 - size / down  # share of the time left after rest
    turned = np.where((left > 0.0) & (up != down), left * up, down - size)
    low = np.where(twist > 0.0, -turned, twist - up)
    high = np.where(twist < 0.0, turned, twist + up)
    return low, high


def slow_down(twist: Array, gains: Array, rim_speed: float) -> npt.NDArray[np.bool_]:
    """Slow down all axes alike, in place, until no rim is above `rim_speed`: `Drive.slowed`.

    `gains` are the speeds of a rim per speed of each axis; `rim_speed` is at most `UNLIMITED`.
    Return which twists are slowed down.
    """
    parts = np.abs(twist) * gains
    rims = parts[0] + parts[1] + parts[2]
    is_slowed: npt.NDArray[np.bool_] = rims > rim_speed
    if is_slowed.any():
        twist *= rim_speed / np.maximum(rims, rim_speed)
    return is_slowed


class MotionLimits:
    """Motion limits of `n` robots in steps of `dt` [s]: `Drive.step` and `limited` for arrays.

    Limits have the shape (3, n) of the twists: broadcasting would take a tenth of a plan's time.
    """

    def __init__(
        self, drive: Drive, max_speed: float, dt: float, n: int, dtype: npt.DTypeLike = float
    ) -> None:
        def repeated(*axes: float) -> Array:
            return np.repeat(np.array(axes, dtype)[:, None], n, axis=1)

        self._up = repeated(*(min(axis.acceleration, UNLIMITED) * dt for axis in drive.axes))
        self._down = repeated(*(min(axis.deceleration, UNLIMITED) * dt for axis in drive.axes))
        if (self._up == self._down).all():
            self._down = self._up
        self._twice_up, self._twice_down = 2.0 * self._up, 2.0 * self._down
        self._fastest = repeated(*(axis.velocity for axis in drive.axes))
        self._lowest = repeated(*(axis.lowest for axis in drive.axes))
        self._gains = repeated(1.0, drive.sideways, drive.lever)
        self._rise = repeated(*(min(axis.acceleration, UNLIMITED) for axis in drive.axes))
        self._fall = repeated(*(min(axis.deceleration, UNLIMITED) for axis in drive.axes))
        self._step = repeated(*(axis.jerk * dt for axis in drive.axes))
        self._is_uneven = self._down is not self._up or bool(np.isfinite(self._step).any())
        self._near = self._up * (1.0 + ROUNDING)
        self._rim_speed, self._max_speed = min(drive.rim_speed, UNLIMITED), max_speed
        self._is_slower = drive.is_slower(max_speed)
        self.n, self.dt = n, np.array(dt, dtype)[()]

    def step(self, twist: Array, wanted: Array) -> Array:
        """Return the twist (3, n) after a step from `twist` towards `wanted`."""
        low, high = bounds(twist, self._up, self._down)
        reached: Array = np.minimum(np.maximum(wanted, low), high)
        reached = np.minimum(np.maximum(reached, self._lowest), self._fastest)
        slow_down(reached, self._gains, self._rim_speed)
        if self._is_slower:
            return reached
        x, y, _ = reached
        reached[:2] *= self._max_speed / np.maximum(np.sqrt(x * x + y * y), self._max_speed)
        return reached

    def mean(self, twist: Array, reached: Array) -> Array:
        """Return the mean twist (3, n) of a step: each axis changes at its limit, then stays.

        A change Δ takes the time Δ/a, in which half of Δ is missing on average: Δ²/(2a) in total.
        """
        change = reached - twist
        twice = self._twice_up
        if self._down is not self._up:
            twice = np.where(np.abs(reached) < np.abs(twist), self._twice_down, twice)
        mean: Array = reached - change * np.abs(change) / twice
        return mean

    def aim(self, wanted: Array) -> Array:
        """Return the twists (3, n) that `follow` ends at, for wanted ones: within all limits."""
        aim: Array = np.minimum(np.maximum(wanted, self._lowest), self._fastest)
        slow_down(aim, self._gains, self._rim_speed)
        return aim

    def follow(self, twist: Array, acceleration: Array, aim: Array) -> tuple[Array, Array]:
        """Return twist and acceleration (3, n) after a step towards `aim`: `Drive.limited`.

        Without a limit of jerk the accelerations are not needed, and stay as they are.
        """
        if self._is_uneven:
            return self._follow(twist, acceleration, aim)
        missing = aim - twist
        reached = np.copysign(self._up, missing)
        reached += twist
        np.abs(missing, out=missing)
        np.copyto(reached, aim, where=missing <= self._near)
        slow_down(reached, self._gains, self._rim_speed)
        return reached, acceleration

    def _follow(self, twist: Array, acceleration: Array, aim: Array) -> tuple[Array, Array]:
        reverses = np.sign(twist) * np.sign(aim) < 0.0
        aim = np.where(reverses & (self._rise != self._fall), 0.0, aim)
        rise = np.where(twist < 0.0, self._fall, self._rise)
        fall = np.where(twist > 0.0, self._fall, self._rise)
        step, slack, missing = self._step, 1.0 + ROUNDING, aim - twist
        needed = missing / self.dt
        near = (missing >= -np.minimum(fall, step) * self.dt * slack) & (
            missing <= np.minimum(rise, step) * self.dt * slack
        )
        near &= np.abs(needed - acceleration) <= step * slack
        change = np.minimum(np.maximum(self._let_off(missing), -fall), rise)
        change = np.minimum(np.maximum(change, acceleration - step), acceleration + step)
        reached = np.where(near, aim, twist + change * self.dt)
        is_slowed = slow_down(reached, self._gains, self._rim_speed)
        acceleration = np.where(near, needed, change)
        return reached, np.where(is_slowed, (reached - twist) / self.dt, acceleration)

    def _let_off(self, missing: Array) -> Array:
        """Return the accelerations of `_let_off` towards missing velocities (3, n)."""
        size, free = np.abs(missing), np.isinf(self._step)
        step = np.where(free, 1.0, self._step)
        n = np.ceil((np.sqrt(1.0 + 8.0 * size / (self.dt * step)) - 1.0) / 2.0)
        n = np.maximum(n, 1.0)
        limited = (size / self.dt + step * n * (n - 1.0) / 2.0) / n
        wanted: Array = np.copysign(np.where(free, size / self.dt, limited), missing)
        return wanted
