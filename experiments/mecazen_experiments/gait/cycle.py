"""The gait cycle of a walk: the mean stride as a Fourier series, and the rhythm of the strides."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mecazen.portable import Floats
from mecazen.skeleton import JOINTS
from scipy.optimize import minimize_scalar

from mecazen_experiments.gait.motion import ANKLES, LEGS, Motion, WalkOnPath

HARMONICS = 12
"""Number of harmonics of the gait cycle: with 8, correct joints get an angle error of 1 deg."""
CORRELATED = 12.0
"""Number of successive frames with about the same error."""
STRIDE_STD_M = 0.005
"""Prior deviation of a joint from its cycle."""
SWINGS = [name.endswith(("knee", "ankle", "heel", "foot", "elbow", "wrist")) for name in JOINTS]
"""Whether a joint belongs to a swinging limb."""
LIMB_M, TRUNK_M = 0.4, 0.04
"""Prior deviation of the first harmonic's amplitude, for limbs and for other joints. The deviation
of the k-th harmonic is k² times smaller for limbs, and k times smaller for other joints."""

SAGITTAL = [0, 2]
"""Forward and up; legs hardly move sideways."""
STEP_STD = 0.1
"""Prior relative deviation of the time of half a stride: several times that of real walkers."""
SHORTEST = 0.5
"""Minimum time of half a stride, as a share of its mean time."""
OUTLIER = 3.0
"""Number of standard deviations beyond which errors have less weight."""
ITERATIONS = 10


class Cycle(NamedTuple):
    """The mean stride of a walk."""

    stride_s: float
    series: Floats
    """The joints relative to the path as a Fourier series: the coefficients (1 + 2 · HARMONICS, 20,
    3) [m] of 1, then of cosines, then of sines."""

    def at(self, t: Floats) -> Floats:
        """Return the joints (n, 20, 3) [m], relative to the path, at times t (n,) [s]."""
        joints: Floats = np.einsum("nk,kji->nji", _basis(t, self.stride_s), self.series)
        return joints

    @property
    def velocity(self) -> Cycle:
        """The derivative of the joints by time."""
        zero, cosines, sines = np.split(self.series, (1, 1 + HARMONICS))
        faster = math.tau / self.stride_s * np.arange(1, HARMONICS + 1)[:, None, None]
        slope = np.concatenate((np.zeros_like(zero), faster * sines, -faster * cosines))
        return self._replace(series=slope)


def cycle(seen: Motion, walk: WalkOnPath) -> Cycle:
    """Return the gait cycle that fits the joints best, each weighted by its reported variance.

    `seen` has left and right corrected, `walk` are the low-passed joints relative to the walker's
    path. The stride time is searched within 10 % of that of the strongest frequency.
    """
    rows = seen.reported
    t = seen.t[rows]
    joints = walk.about(seen.joints)[rows]
    weights = 1.0 / np.sqrt(CORRELATED * (seen.std[rows] ** 2 + STRIDE_STD_M**2))
    orders = np.tile(np.arange(1, HARMONICS + 1), 2)
    limb, trunk = (np.diag(np.append(0.0, c)) for c in (orders**2 / LIMB_M, orders / TRUNK_M))

    def fit(stride: float, which: Sequence[int]) -> tuple[Floats, float]:
        basis = _basis(t, stride)
        series, misfit = np.empty((basis.shape[1], len(which), 3)), 0.0
        for n, joint in enumerate(which):
            w = weights[:, joint, None]
            system = np.concatenate((w * basis, limb if SWINGS[joint] else trunk))
            wanted = np.zeros((len(system), 3))
            wanted[: len(t)] = w * joints[:, joint]
            series[:, n] = np.linalg.lstsq(system, wanted, rcond=None)[0]
            misfit += float(((system @ series[:, n] - wanted) ** 2).sum())
        return series, misfit

    tried = 1.0 / walk.stride_hz * np.linspace(0.9, 1.1, 41)
    misfits = [fit(stride, ANKLES)[1] for stride in tried]
    at = int(np.argmin(misfits[1:-1])) + 1
    stride = minimize_scalar(
        lambda value: fit(value, ANKLES)[1],
        bounds=(tried[at - 1], tried[at + 1]),
        method="bounded",
        options={"xatol": 1e-4},
    ).x
    return Cycle(float(stride), fit(float(stride), range(len(JOINTS)))[0])


def rhythm(seen: Motion, walk: WalkOnPath, mean: Cycle) -> tuple[Floats, Floats]:
    """Return the walker's time as a function of an even time, linear within each half stride.

    An event is visible in a few frames, a stride in all of them. So the timing of a stride is found
    by fitting the mean cycle to the joints of both legs, by iterated linear least squares with the
    reported deviations. `seen` has left and right corrected.

    Returns:
        Even times (n,) [s], spaced by the mean time of half a stride, and the times at which the
        walker reaches their phases.
    """
    rows, legs = seen.reported, [joint for leg in LEGS for joint in leg]
    joints = walk.about(seen.joints)[rows][:, legs][..., SAGITTAL]
    std = np.sqrt(CORRELATED * (seen.std[rows][:, legs, None] ** 2 + STRIDE_STD_M**2))
    t, half = seen.t[rows], mean.stride_s / 2.0
    even = seen.t[0] + half * np.arange(math.ceil((seen.t[-1] - seen.t[0]) / half) + 1)
    prior = np.diff(np.eye(len(even)), axis=0) / (STEP_STD * half)
    velocity = mean.velocity

    knots = even
    for _ in range(ITERATIONS):
        n = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
        length = knots[n + 1] - knots[n]
        part = (t - knots[n]) / length
        # derivative: decrease of the elapsed cycle at each time if a knot is later
        less = np.zeros((len(t), len(knots)))
        less[np.arange(len(t)), n] = (1.0 - part) * half / length
        less[np.arange(len(t)), n + 1] = part * half / length
        places, speeds = (
            curve.at(even[n] + part * half)[:, legs][..., SAGITTAL] for curve in (mean, velocity)
        )
        errors = (joints - places) / std
        weights = np.sqrt(
            np.minimum(1.0, OUTLIER / CORRELATED**0.5 / np.maximum(abs(errors), 1e-9))
        )
        system = (-(weights / std * speeds)[..., None] * less[:, None, None]).reshape(-1, len(even))
        later = np.linalg.lstsq(
            np.concatenate((system, prior)),
            np.concatenate(((weights * errors).ravel(), -prior @ (knots - even))),
            rcond=None,
        )[0]
        steps = np.maximum(np.diff(knots + later), SHORTEST * half)
        knots = knots[0] + later[0] + np.concatenate(([0.0], np.cumsum(steps)))
    return even, knots


def regular(times: Floats, even: Floats, actual: Floats) -> Floats:
    """Return the times of an event in each stride, all at the event's mean phase of the rhythm.

    The result spans the first to the last of the measured `times`.
    """
    if not len(times):
        return times
    stride = 2.0 * (even[1] - even[0])
    phases = np.interp(times, actual, even) / stride
    mean = np.angle(np.exp(2j * np.pi * phases).mean()) / (2.0 * np.pi)
    first, last = np.rint(phases[[0, -1]] - mean)
    steady: Floats = np.interp(stride * (mean + np.arange(first, last + 1.0)), even, actual)
    return steady


def _basis(t: Floats, stride: float) -> Floats:
    """Return 1, cosines and sines (n, 1 + 2 · HARMONICS) of the gait cycle."""
    phases = 2.0 * np.pi / stride * np.outer(t, np.arange(1, HARMONICS + 1))
    return np.concatenate((np.ones((len(t), 1)), np.cos(phases), np.sin(phases)), axis=1)
