"""Simulates commands within the limits of the wheels and the controller."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from mecazen.drive import Array, MotionLimits
from mecazen.geometry import Twist2D

Command = Callable[[int, Array, Array, Array], Array]
"""Maps a step and x, y and yaw, each (n), to velocities along odom's axes and yaw rates (3, n)."""


class Rollout(NamedTuple):
    """Poses after each step, each (steps, n): x, y [m], cos and sin of the yaw.

    `commands` (steps, 3, n) are the velocities along odom's axes and yaw rates commanded.
    """

    x: Array
    y: Array
    c: Array
    s: Array
    commands: Array


def roll(yaw: float, twist: Twist2D, steps: int, limits: MotionLimits, command: Command) -> Rollout:
    """Return the motion of robots that start at the origin with a yaw [rad] and a twist.

    A step leads along the mean of the directions at its ends.
    """
    n, dt, dtype = limits.n, limits.dt, limits.dt.dtype
    x, y, angle = np.zeros(n, dtype), np.zeros(n, dtype), np.full(n, yaw, dtype)
    now = np.repeat(np.array(twist, dtype)[:, None], n, axis=1)
    c, s = np.cos(angle), np.sin(angle)
    poses, commands = np.empty((4, steps, n), dtype), np.empty((steps, 3, n), dtype)
    wanted, half = np.empty_like(now), dtype.type(0.5)
    for k in range(steps):
        commands[k] = command(k, x, y, angle)
        vx, vy, wanted[2] = commands[k]
        wanted[0], wanted[1] = c * vx + s * vy, c * vy - s * vx
        reached = limits.step(now, wanted)
        mx, my, turn = limits.mean(now, reached) * dt
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
    """Return a `Command` that replays commands (steps, 3, n), independent of the robots' poses."""
    return lambda k, *_: commands[k]
