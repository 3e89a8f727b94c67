"""Where commands take the robot, within what its wheels and its controller can do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.drive import Drive
from mecazen.geometry import Twist2D

Array = npt.NDArray[Any]
"""In double precision for few, in single precision for many."""

Command = Callable[[int, Array, Array, Array], Array]
"""From step, x, y and yaw, each (n), to velocities along odom's axes and yaw rates (3, n)."""


UNLIMITED = 1e9
"""[m/s]: what has no limit is no faster."""


class Rollout(NamedTuple):
    """Poses after each step, each (steps, n): x, y [m], cos and sin of the yaw.

    `commands` (steps, 3, n) are what was commanded.
    """

    x: Array
    y: Array
    c: Array
    s: Array
    commands: Array


class Able:
    """What the robot is able to do in a step of `dt` [s]: its axes first, then its wheels.

    As the controller: each axis keeps its limits, then all are slowed down alike until no rim is
    faster than it can be. `max_speed` [m/s] limits the planar speed. `n` robots are alike: limits
    as wide as their twists, for NumPy takes a tenth of a plan to broadcast them.
    """

    def __init__(
        self, drive: Drive, max_speed: float, dt: float, n: int, dtype: npt.DTypeLike = float
    ) -> None:
        axes = drive.axes
        self._up, self._down, self._fastest, self._gains = (
            np.repeat(np.array(values, dtype)[:, None], n, axis=1)
            for values in (
                [axis.acceleration * dt for axis in axes],
                [axis.deceleration * dt for axis in axes],
                [axis.velocity for axis in axes],
                [1.0, drive.sideways, drive.lever],
            )
        )
        self._slowest, self._twice_up, self._twice_down = (
            factor * limit
            for factor, limit in ((-1.0, self._fastest), (2.0, self._up), (2.0, self._down))
        )
        self._even = bool((self._up == self._down).all())
        self._rim_speed, self._max_speed = min(drive.rim_speed, UNLIMITED), max_speed
        self.n, self.dt = n, np.array(dt, dtype)[()]
        # of what the wheels can do, nothing may be left to limit
        self._any_speed = max_speed >= drive.rim_speed / min(drive.sideways, 1.0)

    def reach(self, twist: Array, wanted: Array) -> Array:
        """Return the twist (3, n) after a step from `twist` towards `wanted`, in base_link."""
        up, down = self._up, self._down
        if self._even:
            low, high = twist - up, twist + up
        else:
            low = twist - np.where(twist > 0.0, down, up)
            high = twist + np.where(twist < 0.0, down, up)
        reached: Array = np.minimum(np.maximum(wanted, low), high)
        reached = np.minimum(np.maximum(reached, self._slowest), self._fastest)
        rims = np.abs(reached) * self._gains
        fastest = np.maximum(rims[0] + rims[1] + rims[2], self._rim_speed)
        reached *= self._rim_speed / fastest
        if self._any_speed:
            return reached
        x, y, _ = reached
        reached[:2] *= self._max_speed / np.maximum(np.sqrt(x * x + y * y), self._max_speed)
        return reached

    def mean(self, twist: Array, reached: Array) -> Array:
        """Return the mean twist (3, n) of a step: each axis changes as fast as it can, then stays.

        A change Δ takes the time Δ/a, in which half of it is missing: Δ²/(2a) in all.
        """
        change = reached - twist
        twice = self._twice_up
        if not self._even:
            twice = np.where(np.abs(reached) < np.abs(twist), self._twice_down, twice)
        mean: Array = reached - change * np.abs(change) / twice
        return mean


def step_towards(twist: Twist2D, wanted: Twist2D, able: Able) -> Twist2D:
    """Return the twist after a single step, both in base_link."""
    reached = able.reach(np.array(twist)[:, None], np.array(wanted)[:, None])
    return Twist2D(*reached[:, 0].tolist())


def roll(yaw: float, twist: Twist2D, steps: int, able: Able, command: Command) -> Rollout:
    """Return where robots get that begin at the origin with a yaw [rad] and a twist.

    A step leads along the mean of the directions at its ends.
    """
    n, dt, dtype = able.n, able.dt, able.dt.dtype
    x, y, angle = np.zeros(n, dtype), np.zeros(n, dtype), np.full(n, yaw, dtype)
    now = np.repeat(np.array(twist, dtype)[:, None], n, axis=1)
    c, s = np.cos(angle), np.sin(angle)
    poses, commands = np.empty((4, steps, n), dtype), np.empty((steps, 3, n), dtype)
    wanted, half = np.empty_like(now), dtype.type(0.5)
    for k in range(steps):
        commands[k] = command(k, x, y, angle)
        vx, vy, wanted[2] = commands[k]
        wanted[0], wanted[1] = c * vx + s * vy, c * vy - s * vx
        reached = able.reach(now, wanted)
        mx, my, turn = able.mean(now, reached) * dt
        angle = angle + turn
        last_c, last_s = c, s
        c, s = np.cos(angle), np.sin(angle)
        mean_c, mean_s = (last_c + c) * half, (last_s + s) * half
        x = x + mean_c * mx - mean_s * my
        y = y + mean_s * mx + mean_c * my
        poses[0, k], poses[1, k], poses[2, k], poses[3, k] = x, y, c, s
        now = reached
    return Rollout(poses[0], poses[1], poses[2], poses[3], commands)


def follow(commands: Array) -> Command:
    """Return what gives the commands (steps, 3, n), wherever the robots are."""
    return lambda k, *_: commands[k]
