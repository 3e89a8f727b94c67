"""The rhythm of a walk: the timing of the strides relative to the mean gait cycle.

An event is visible in a few frames, a stride in all of them. So the timing of a stride is found by
fitting the mean cycle to the joints of both legs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from mecazen.portable import Floats
from mecazen.skeleton import INDEX, SIDES
from mecazen_tools.table import Floats

from mecazen_experiments.capture import Motion
from mecazen_experiments.gait.path import WalkOnPath
from mecazen_experiments.refine import CORRELATED, STRIDE_STD_M, at, cycle, unswapped

LEGS = [INDEX[f"{side}_{name}"] for side in SIDES for name in ("knee", "ankle", "heel", "foot")]
SAGITTAL = [0, 2]
"""Forward and up; legs hardly move sideways."""
STEP_STD = 0.1
"""Prior relative deviation of the time of half a stride: several times that of real walkers."""
SHORTEST = 0.5
"""Minimum time of half a stride, as a share of its mean time."""
OUTLIER = 3.0
"""Number of standard deviations beyond which errors have less weight."""
ITERATIONS = 10


class Rhythm(NamedTuple):
    """The walker's time as a function of an even time, linear within each half stride."""

    even: Floats
    """Even times (n,) [s], spaced by the mean time of half a stride."""
    actual: Floats
    """Times (n,) [s] at which the walker reaches the phases of the even times."""

    def regular(self, times: Floats) -> Floats:
        """Return the times of an event in each stride, all at the event's mean phase.

        The result spans the first to the last of the measured `times`.
        """
        if not len(times):
            return times
        stride = 2.0 * (self.even[1] - self.even[0])
        phases = np.interp(times, self.actual, self.even) / stride
        mean = np.angle(np.exp(2j * np.pi * phases).mean()) / (2.0 * np.pi)
        first, last = np.rint(phases[[0, -1]] - mean)
        even = stride * (mean + np.arange(first, last + 1.0))
        regular: Floats = np.interp(even, self.even, self.actual)
        return regular


def rhythm(seen: Motion, walk: WalkOnPath) -> Rhythm:
    """Return the rhythm of a walk; `walk` are the low-passed joints about the walker's path.

    The result is the most probable rhythm, by iterated linear least squares with the reported
    deviations.
    """
    seen = unswapped(seen)
    stride, series = cycle(seen, walk)
    order = len(series) // 2
    faster = math.tau / stride * np.arange(1, order + 1)[:, None, None]
    zero, cosines, sines = np.split(series, (1, 1 + order))
    slope = np.concatenate((np.zeros_like(zero), faster * sines, -faster * cosines))

    rows, legs = seen.reported, np.ix_(range(len(seen.t)), LEGS, SAGITTAL)
    joints = walk.about(seen.joints)[legs][rows]
    std = np.sqrt(CORRELATED * (seen.std[rows][:, LEGS, None] ** 2 + STRIDE_STD_M**2))
    t, half = seen.t[rows], stride / 2.0
    even = seen.t[0] + half * np.arange(math.ceil((seen.t[-1] - seen.t[0]) / half) + 1)
    prior = np.diff(np.eye(len(even)), axis=0) / (STEP_STD * half)

    knots = even
    for _ in range(ITERATIONS):
        n = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
        length = knots[n + 1] - knots[n]
        part = (t - knots[n]) / length
        # derivative: decrease of the elapsed cycle at each time if a knot is later
        less = np.zeros((len(t), len(knots)))
        less[np.arange(len(t)), n] = (1.0 - part) * half / length
        less[np.arange(len(t)), n + 1] = part * half / length
        places, speeds = (at(even[n] + part * half, stride, terms) for terms in (series, slope))
        errors = (joints - places[:, LEGS][..., SAGITTAL]) / std
        weights = np.sqrt(
            np.minimum(1.0, OUTLIER / CORRELATED**0.5 / np.maximum(abs(errors), 1e-9))
        )
        speeds = weights / std * speeds[:, LEGS][..., SAGITTAL]
        system = (-speeds[..., None] * less[:, None, None]).reshape(-1, len(knots))
        later = np.linalg.lstsq(
            np.concatenate((system, prior)),
            np.concatenate(((weights * errors).ravel(), -prior @ (knots - even))),
            rcond=None,
        )[0]
        steps = np.maximum(np.diff(knots + later), SHORTEST * half)
        knots = knots[0] + later[0] + np.concatenate(([0.0], np.cumsum(steps)))
    return Rhythm(even, knots)
