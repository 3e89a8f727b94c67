"""The estimator of docs/mocap.md: it refines the observed skeleton of a person who walks steadily.

It uses general knowledge of bodies and gaits, and nothing of this simulator. The prior deviations
below are round numbers: for those that were tested, half or twice the value changes no joint's mean
error by more than 0.4 deg.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mecazen.skeleton import INDEX, JOINTS, SIDES
from mecazen_tools.table import Bools, Floats
from scipy.optimize import least_squares, minimize_scalar

from mecazen_experiments.gait.motion import (
    ANKLES,
    BALLS,
    HEELS,
    HIPS,
    LEGS,
    MIN_SPEED_M_S,
    PATH_HZ,
    SHOULDERS,
    Motion,
    WalkOnPath,
    leftward,
    lowpass,
)

CUTOFF_HZ = 6.0
"""Cut-off of joints in a gait; D. A. Winter, Biomechanics and Motor Control of Human Movement."""
TURNING_HZ = 0.3
"""Cut-off of the direction from right to left; slower than confusions of left and right."""
SWAP_RATE = 0.01
"""Prior probability that a confusion of left and right begins or ends in a frame."""
MIN_FRAMES = 20
"""Minimum number of frames for refinement."""
PHASES = 25
"""Number of phases of the gait cycle at which bones must have the same length."""

LOWER = ("knee", "ankle", "heel", "foot")
UPPER = ("shoulder", "elbow", "wrist", "hip")
BONES = ("hip", "knee"), ("knee", "ankle"), ("ankle", "heel"), ("ankle", "foot"), ("heel", "foot")
"""Bones of each leg, by their ends; both legs have the same lengths."""
ENDS = np.array([[[INDEX[f"{s}_{end}"] for end in bone] for bone in BONES] for s in SIDES])
TRUNK = [INDEX[name] for name in ("pelvis", "spine", "neck")]
SOLES = [joint for foot in zip(HEELS, BALLS, strict=True) for joint in foot]
FITTED = [n for n, name in enumerate(JOINTS) if not name.endswith(("head", "elbow", "wrist"))]
"""Joints whose biases are estimated."""

LEAST_STD_M = 1e-4
"""Lower bound of deviations: the resolution of messages."""
BONE_STD_M = 0.1
"""Apparent change of a bone's length [m]: larger than the true change, since errors at the phases
of a cycle are not independent."""
PLACE_STD_M = 0.01
"""Deviation of a joint between two others from their midpoint."""
NECK_STD_M = 0.02
"""Deviation of the neck from the midpoint of the shoulders."""
FLOOR_STD_M = 0.005
"""Deviation of the lowest point of heel and ball from the floor."""
KNEE_STD_RAD = 0.03
"""Deviation of a knee's extension beyond straight."""
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


def unswapped(seen: Motion) -> Motion:
    """Return the motion with left and right corrected.

    The likeliest sequence of two hidden states is found (A. Viterbi, IEEE Trans. Inf. Theory 13,
    1967), once for the joints that swap with the knees and once for hips and arms. A left joint is
    assumed to be to the left of the right joint, by their median distance in the whole walk.
    """
    rows = np.flatnonzero(seen.reported)
    if len(rows) < MIN_FRAMES:
        return seen
    joints, std = seen.joints[rows], seen.std[rows]
    left = _left(joints, seen.rate_hz)
    order = np.tile(np.arange(len(JOINTS)), (len(seen.t), 1))
    for names in (UPPER, LOWER):
        pairs = np.array([[INDEX[f"{side}_{name}"] for side in SIDES] for name in names])
        lines = joints[:, pairs[:, 0], :2] - joints[:, pairs[:, 1], :2]
        apart = np.einsum("njk,nk->nj", lines, left)
        variance = (std[:, pairs] ** 2).sum(axis=-1)
        # log-likelihood ratios of no swap to a swap, and of no change to a change
        evidence = (2.0 * apart * np.median(apart, axis=0) / variance).sum(axis=-1) / CORRELATED
        # the median of the square of a normal deviate is 0.455 times the variance
        change = np.maximum(np.median(np.diff(apart, axis=0) ** 2, axis=0) / 0.455, 1e-6)
        steady = (2.0 * apart[1:] * apart[:-1] / change).sum(axis=-1) / len(names)
        swapped = rows[_viterbi(evidence, np.append(0.0, steady))]
        order[np.ix_(swapped, pairs.ravel())] = pairs[:, ::-1].ravel()
    at = np.arange(len(seen.t))[:, None], order
    return seen._replace(joints=seen.joints[at], std=seen.std[at], confidence=seen.confidence[at])


def smooth(seen: Motion) -> Floats | None:
    """Return the joints (n, 20, 3) [m] with gaps interpolated, and low-passed.

    `seen` has left and right corrected. The result is None if too few frames report a body.
    """
    rows = np.flatnonzero(seen.reported)
    if len(rows) < max(MIN_FRAMES, len(seen.t) // 2):
        return None
    flat = seen.joints.reshape(len(seen.t), -1)
    closed = np.stack([np.interp(seen.t, seen.t[rows], column[rows]) for column in flat.T], axis=-1)
    filtered: Floats = lowpass(closed, seen.rate_hz, CUTOFF_HZ).reshape(seen.joints.shape)
    return filtered


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


def refine(seen: Motion, walk: WalkOnPath, mean: Cycle) -> Floats:
    """Return the refined joints (n, 20, 3) [m] of `seen`, in a level frame with the floor at 0.

    `seen` has left and right corrected. Motion that does not repeat in every stride is treated as
    the tracker's noise, as far as the reported deviations allow.
    """
    phases = np.arange(PHASES) / PHASES * mean.stride_s
    bias = biases(mean.at(phases), np.median(seen.std[seen.reported], axis=0))
    joints = mean.at(seen.t)
    # the mean of cycle and frame, each weighted by its inverse variance
    gain = STRIDE_STD_M**2 / (STRIDE_STD_M**2 + seen.std[..., None] ** 2)
    strayed = np.where(seen.reported[:, None, None], gain * (walk.about(seen.joints) - joints), 0.0)
    return walk.placed(joints + strayed - bias)


def biases(joints: Floats, std: Floats) -> Floats:
    """Return the constant error of each joint's position (20, 3) [m] over the gait cycle.

    The result is the most probable error, with a normal prior of the reported deviations std (20,)
    [m]. `joints` (PHASES, 20, 3) [m] are those of the cycle. Bones keep their lengths, the pelvis
    is between the hips, the trunk is straight, ankles are above the line from heel to ball, feet
    come down to the floor, and knees do not bend backwards.
    """
    prior = np.maximum(std[FITTED, None], LEAST_STD_M)
    lengths = _lengths(joints).mean(axis=(0, 1))
    lowest = joints[:, SOLES, 2].min(axis=0)

    def expand(x: Floats) -> Floats:
        bias = np.zeros((len(JOINTS), 3))
        bias[FITTED] = x[len(BONES) :].reshape(-1, 3) * prior
        return bias

    def residuals(x: Floats) -> Floats:
        bias = expand(x)
        placed = joints - bias
        mean = placed.mean(axis=0)
        hips, shoulders = mean[HIPS], mean[SHOULDERS]
        pelvis, spine, neck = mean[TRUNK]
        terms = (
            x[len(BONES) :],
            (_lengths(placed) - x[: len(BONES)]) / BONE_STD_M,
            np.minimum(_flexions(placed), 0.0) / KNEE_STD_RAD,
            (lowest - bias[SOLES, 2]) / FLOOR_STD_M,
            (hips.mean(axis=0) - pelvis) / PLACE_STD_M,
            ((pelvis + neck) / 2.0 - spine) / PLACE_STD_M,
            (shoulders.mean(axis=0) - neck) / NECK_STD_M,
            (hips[0] - hips[1])[[0, 2]] / PLACE_STD_M,
            _aside(mean) / PLACE_STD_M,
        )
        return np.concatenate([part.ravel() for part in terms])

    begin = np.concatenate((lengths, np.zeros(3 * len(FITTED))))
    return expand(least_squares(residuals, begin, x_scale="jac", ftol=1e-4).x)


def _left(joints: Floats, rate_hz: float) -> Floats:
    """Return the direction to the left (n, 2) of a body (n, 20, 3) [m], of length 1.

    If the whole body is mirrored for seconds, its left is on the wrong side of the path. The
    correct side is the one where left is most of the time.
    """
    left = lowpass(leftward(joints), rate_hz, TURNING_HZ)
    left /= np.hypot(*left.T)[:, None]
    velocity = np.gradient(lowpass(joints[:, 0, :2], rate_hz, PATH_HZ), axis=0) * rate_hz
    aside = velocity[:, 0] * left[:, 1] - velocity[:, 1] * left[:, 0]
    wrong = (aside * np.median(aside) < 0.0) & (np.hypot(*velocity.T) > MIN_SPEED_M_S)
    return np.where(wrong[:, None], -left, left)


def _lengths(joints: Floats) -> Floats:
    """Return the lengths (n, 2, 5) [m] of each side's `BONES`."""
    bones = joints[:, ENDS[..., 1]] - joints[:, ENDS[..., 0]]
    lengths: Floats = np.sqrt(np.einsum("...k,...k", bones, bones))
    return lengths


def _aside(joints: Floats) -> Floats:
    """Return the lateral offset of the ankles (2,) [m] from the line heel to ball, from above."""
    heels = joints[HEELS, :2]
    (x, y), (ahead, left) = (joints[BALLS, :2] - heels).T, (joints[ANKLES, :2] - heels).T
    aside: Floats = (x * left - y * ahead) / np.hypot(x, y)
    return aside


def _flexions(joints: Floats) -> Floats:
    """Return both knees' flexion (n, 2) [rad] about the axis to the left; extension is negative."""
    bones = joints[:, ENDS[:, :2, 1]] - joints[:, ENDS[:, :2, 0]]
    (a, b), (c, d) = np.moveaxis(bones[..., [0, 2]], (2, 3), (0, 1))
    flexions: Floats = np.arctan2(b * c - a * d, a * c + b * d)
    return flexions


def _viterbi(evidence: Floats, steady: Floats) -> Bools:
    """Return the likeliest sequence of two states (n,): False is the first, True the second.

    `evidence` (n,) are log-likelihood ratios of the first state to the second for each sample.
    `steady` (n,) are those of no change to a change from the previous sample.
    """
    cost, came = np.zeros(2), []
    for value, same in zip(evidence, steady, strict=True):
        changed = cost[::-1] + (same - np.log(SWAP_RATE))
        came.append(changed < cost)
        cost = np.minimum(changed, cost) + np.array([0.0, value])
    states = [int(cost[1] < cost[0])]
    for change in reversed(came[1:]):
        states.append(states[-1] ^ change[states[-1]])
    return np.array(states[::-1], dtype=bool)
