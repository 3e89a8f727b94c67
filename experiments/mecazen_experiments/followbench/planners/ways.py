"""Paths of a unicycle: sampled commands and their rollouts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from mecazen.geometry import Pose2D
from mecazen.portable import Floats

from mecazen_experiments.followbench.pedestrians import STEP_S
from mecazen_experiments.followbench.unicycle import (
    ACCELERATION_V,
    ACCELERATION_W,
    MAX_V,
    MAX_W,
)

TIMES: Floats = np.array([0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.3, 2.6])
"""Times of a path's poses [s]: dense at first, when contacts are decided."""
STEPS = len(TIMES)
DT: Floats = np.diff(TIMES, prepend=0.0)
SPEEDS = (-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)
TURNS = (-3.0, -1.5, -0.7, -0.3, 0.0, 0.3, 0.7, 1.5, 3.0)
"""Sampled speeds [m/s] and yaw rates [rad/s]."""
SWITCHES_S = 0.5, 1.1
"""Times at which a turn ends in two-phase paths."""
KNOTS_S = np.array([0.1, 0.6, 1.4, 2.6])
"""Times of the knots of the noise around the last plan, which is linear between them."""
NOISE = 0.5, 0.7
"""Standard deviations of the noise [m/s, rad/s] ..."""
FINE = 0.3
"""... and the factor on them for every other sample."""
SAMPLES = 128


class Ways(NamedTuple):
    """Commands and poses at the times, each (n, STEPS)."""

    v: Floats
    w: Floats
    x: Floats
    y: Floats
    c: Floats
    """Cosine of the yaw."""
    s: Floats


def _library() -> tuple[Floats, Floats]:
    """Return commands v and w (n, STEPS): arcs, arcs that end straight, and S-curves."""
    arcs = [(v, w, w, 0.0) for v in SPEEDS for w in TURNS]
    bends = [(v, w, 0.0, at) for v, w, _, _ in arcs if v and w for at in SWITCHES_S]
    swerves = [(v, w, -w, 0.7) for v in (-1.5, 0.0, 1.5) for w in (-2.0, 2.0)]
    v, w, then, at = np.array(arcs + bends + swerves).T[..., None]
    return v + np.zeros(STEPS), np.where(at > TIMES, w, then)


LIBRARY = _library()
SUDDEN: tuple[Floats, Floats] = (
    np.repeat([-2.0, -1.0, 0.0, 1.0, 2.0], 5)[:, None] + np.zeros(STEPS),
    np.tile([-3.0, -1.5, 0.0, 1.5, 3.0], 5)[:, None] + np.zeros(STEPS),
)
"""Commands of an escape, which take effect at once if the limits allow it."""


def sample(
    plan: tuple[Floats, Floats] | None, random: np.random.Generator
) -> tuple[Floats, Floats, int]:
    """Return commands v and w (n, STEPS), and the number of commands to be reached gently.

    The fixed commands come first, then the last plan, shifted by one step, and samples around it.
    """
    v, w = [LIBRARY[0], SUDDEN[0]], [LIBRARY[1], SUDDEN[1]]
    if plan is not None:
        knots = random.standard_normal((2, len(KNOTS_S), SAMPLES))
        before = np.minimum(np.searchsorted(KNOTS_S, TIMES, "right") - 1, len(KNOTS_S) - 2)
        share = ((TIMES - KNOTS_S[before]) / np.diff(KNOTS_S)[before])[:, None]
        noise = (1.0 - share) * knots[:, before] + share * knots[:, before + 1]
        noise[..., ::2] *= FINE
        noise[..., 0] = 0.0
        v.append(np.interp(TIMES + STEP_S, TIMES, plan[0]) + NOISE[0] * noise[0].T)
        w.append(np.interp(TIMES + STEP_S, TIMES, plan[1]) + NOISE[1] * noise[1].T)
    return np.concatenate(v), np.concatenate(w), len(LIBRARY[0])


def roll(
    start: Pose2D, now: tuple[float, float], commands: tuple[Floats, Floats], gentle: int
) -> Ways:
    """Return the paths of commands from a pose with a speed and a yaw rate.

    In the first `gentle` paths, speed and yaw rate change at most at the rate at which the robot
    speeds up, even to slow down; in the others as fast as the robot's limits allow.
    """
    v = _reached(commands[0], now[0], MAX_V, ACCELERATION_V, gentle)
    w = _reached(commands[1], now[1], MAX_W, ACCELERATION_W, gentle)
    yaw = start.yaw + np.cumsum(w * DT, axis=1)
    # each Euler step of 0.1 s of the robot follows the heading before the step
    along = yaw - w * ((DT + STEP_S) / 2.0)
    x = start.x + np.cumsum(v * DT * np.cos(along), axis=1)
    y = start.y + np.cumsum(v * DT * np.sin(along), axis=1)
    return Ways(v, w, x, y, np.cos(yaw), np.sin(yaw))


def _reached(wanted: Floats, now: float, most: float, gain: float, gentle: int) -> Floats:
    """Return the values (n, STEPS) that are reached within the limits for wanted values."""
    wanted = np.minimum(np.maximum(wanted, -most), most)
    reached = np.empty_like(wanted)
    last = np.full(len(wanted), now)
    for k, dt in enumerate(DT):
        up, down = last + gain * dt, last - gain * dt
        # towards and beyond zero, and from rest, the robot changes at once
        up[gentle:][last[gentle:] <= 0.0] = most
        down[gentle:][last[gentle:] >= 0.0] = -most
        last = np.minimum(np.maximum(wanted[:, k], down), up)
        reached[:, k] = last
    return reached
