"""How the strides of a walk differ in time: when the walker is where in the mean gait cycle.

An event shows in a few frames, a stride in all of them: its time is the one with which the mean
cycle fits the joints of both legs best.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from mecazen.skeleton import INDEX, SIDES

from mecazen_experiments.capture import Motion
from mecazen_experiments.gait.path import WalkOnPath
from mecazen_experiments.refine import CORRELATED, STRIDE_STD_M, at, cycle, unswapped
from mecazen_experiments.table import Floats

LEGS = [INDEX[f"{side}_{name}"] for side in SIDES for name in ("knee", "ankle", "heel", "foot")]
SAGITTAL = [0, 2]
"""Forward and up: to the left, legs hardly move."""
STEP_STD = 0.1
"""A priori deviation of the time of half a stride, as a share: several times that of walkers."""
SHORTEST = 0.5
"""Share of its mean time that half a stride takes at least."""
OUTLIER = 3.0
"""Errors of more standard deviations weigh less."""
ITERATIONS = 10


class Rhythm(NamedTuple):
    """The time of the walker against an even one, linear between both ends of each half stride."""

    even: Floats
    """Times (n,) [s] that are half a stride's mean time apart."""
    own: Floats
    """When the walker is where an even one is then (n,) [s]."""

    def regular(self, times: Floats) -> Floats:
        """Return the times of an event of each stride, all at its mean place in the cycle.

        They begin with the first and end with the last of the `times` at which it was found.
        """
        if not len(times):
            return times
        stride = 2.0 * (self.even[1] - self.even[0])
        phases = np.interp(times, self.own, self.even) / stride
        mean = np.angle(np.exp(2j * np.pi * phases).mean()) / (2.0 * np.pi)
        first, last = np.rint(phases[[0, -1]] - mean)
        even = stride * (mean + np.arange(first, last + 1.0))
        regular: Floats = np.interp(even, self.even, self.own)
        return regular


def rhythm(seen: Motion, walk: WalkOnPath) -> Rhythm:
    """Return the rhythm of a walk; `walk` are the low-passed joints about the walker's path.

    It is the most probable one, by iterated linear least squares with the reported deviations.
    """
    seen = unswapped(seen)
    stride, series = cycle(seen, walk)
    order = len(series) // 2
    faster = math.tau / stride * np.arange(1, order + 1)[:, None, None]
    slope = np.zeros_like(series)
    slope[1 : 1 + order], slope[1 + order :] = (
        faster * series[1 + order :],
        -faster * series[1 : 1 + order],
    )

    rows, legs = seen.reported, np.ix_(range(len(seen.t)), LEGS, SAGITTAL)
    joints = walk.about(seen.joints)[legs][rows]
    std = np.sqrt(CORRELATED * (seen.std[rows][:, LEGS, None] ** 2 + STRIDE_STD_M**2))
    t, half = seen.t[rows], stride / 2.0
    even = seen.t[0] + half * np.arange(math.ceil((seen.t[-1] - seen.t[0]) / half) + 1)
    usual = np.diff(np.eye(len(even)), axis=0) / (STEP_STD * half)

    own = even
    for _ in range(ITERATIONS):
        n = np.clip(np.searchsorted(own, t, side="right") - 1, 0, len(own) - 2)
        length = own[n + 1] - own[n]
        part = (t - own[n]) / length
        # how much less of the cycle is over at each time if a knot is later
        less = np.zeros((len(t), len(own)))
        less[np.arange(len(t)), n] = (1.0 - part) * half / length
        less[np.arange(len(t)), n + 1] = part * half / length
        places, speeds = (at(even[n] + part * half, stride, of) for of in (series, slope))
        wrong = (joints - places[:, LEGS][..., SAGITTAL]) / std
        weights = np.sqrt(np.minimum(1.0, OUTLIER / CORRELATED**0.5 / np.maximum(abs(wrong), 1e-9)))
        speeds = weights / std * speeds[:, LEGS][..., SAGITTAL]
        system = (-speeds[..., None] * less[:, None, None]).reshape(-1, len(own))
        later = np.linalg.lstsq(
            np.concatenate((system, usual)),
            np.concatenate(((weights * wrong).ravel(), -usual @ (own - even))),
            rcond=None,
        )[0]
        steps = np.maximum(np.diff(own + later), SHORTEST * half)
        own = own[0] + later[0] + np.concatenate(([0.0], np.cumsum(steps)))
    return Rhythm(even, own)
