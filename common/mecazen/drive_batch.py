"""Motion limits for arrays of twists: the model of `drive`, with bit-identical results.

Twists are (3, ...): x, y [m/s] and yaw rate [rad/s] in base_link.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from mecazen.drive import Drive

Array = npt.NDArray[Any]
"""Double precision for few twists, single precision for many."""

UNLIMITED = 1e9
"""Value for the speed of a rim or the acceleration of an axis without a limit."""


def bounds(twist: Array, up: Array, down: Array) -> tuple[Array, Array]:
    """Return the lowest and highest twists that the axes reach: `Limits.reach` without `velocity`.

    Args:
        twist: The twists at the start.
        up: The change of each axis over the step while its speed grows.
        down: The same while its speed falls.
    """
    if up is down:
        return twist - up, twist + up
    size = np.abs(twist)
    left = 1.0 - size / down  # share of the time left after rest
    turned = np.where((left > 0.0) & (up != down), left * up, down - size)
    low = np.where(twist > 0.0, -turned, twist - up)
    high = np.where(twist < 0.0, turned, twist + up)
    return low, high


def slow_down(twist: Array, gains: Array, rim_speed: float) -> None:
    """Slow down all axes alike, in place, until no rim is above `rim_speed`: `Drive.slowed`.

    Args:
        twist: The twists that the axes reach.
        gains: Speed of a rim per speed of each axis.
        rim_speed: At most `UNLIMITED` [m/s].
    """
    rims = np.abs(twist) * gains
    twist *= rim_speed / np.maximum(rims[0] + rims[1] + rims[2], rim_speed)


class MotionLimits:
    """Motion limits of `n` robots in steps of `dt` [s]: `Drive.step` for arrays.

    Limits have the shape (3, n) of the twists: broadcasting would take a tenth of a plan's time.
    """

    def __init__(
        self, drive: Drive, max_speed: float, dt: float, n: int, dtype: npt.DTypeLike = float
    ) -> None:
        axes = drive.axes
        self._up, self._down, self._fastest, self._gains = (
            np.repeat(np.array(values, dtype)[:, None], n, axis=1)
            for values in (
                [min(axis.acceleration, UNLIMITED) * dt for axis in axes],
                [min(axis.deceleration, UNLIMITED) * dt for axis in axes],
                [axis.velocity for axis in axes],
                [1.0, drive.sideways, drive.lever],
            )
        )
        if (self._up == self._down).all():
            self._down = self._up
        self._slowest, self._twice_up, self._twice_down = (
            factor * limit
            for factor, limit in ((-1.0, self._fastest), (2.0, self._up), (2.0, self._down))
        )
        self._rim_speed, self._max_speed = min(drive.rim_speed, UNLIMITED), max_speed
        self.n, self.dt = n, np.array(dt, dtype)[()]
        self._is_slower = drive.is_slower(max_speed)

    def step(self, twist: Array, wanted: Array) -> Array:
        """Return the twist (3, n) after a step from `twist` towards `wanted`."""
        low, high = bounds(twist, self._up, self._down)
        reached: Array = np.minimum(np.maximum(wanted, low), high)
        reached = np.minimum(np.maximum(reached, self._slowest), self._fastest)
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
