"""Foot strikes and foot offs of a walk, from the joints or from the planted feet."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.portable import Floats
from mecazen.skeleton import INDEX, SIDES
from scipy.signal import find_peaks

from mecazen_experiments.gait.path import HEELS, WalkOnPath, lowpass, stride_frequency

PROMINENCE = 0.3
"""Prominence of an event's extremum, in standard deviations of its signal."""
STEADY_STRIDES = 2.5
"""Cut-off of the low-pass on joints for finding events, as a multiple of the stride frequency."""
DOUBT = 0.25
"""Relative difference of a stride's time from the median of its side above which it is doubtful."""
CONTACT_M = 0.001
"""Height of the lowest point of a true foot below which the foot touches the floor [m]."""
NEAR_S = 0.2
"""Largest delay between an event and the same event by another method [s]."""
BALLS = tuple(INDEX[f"{side}_foot"] for side in SIDES)
STRIKE_EARLY_S, OFF_LATE_S = 0.021, 0.030
"""Mean times by which `zeni` finds strikes too early and offs too late.

The values are from walks that no study scores; their study is at commit b049a409.
"""


class Events(NamedTuple):
    """Times [s] of the events of the left and of the right foot."""

    strikes: tuple[Floats, Floats]
    offs: tuple[Floats, Floats]

    def corrected(self) -> Events:
        """Return events of `zeni` without their mean errors."""
        (left, right), (left_off, right_off) = self
        early, late = STRIKE_EARLY_S, OFF_LATE_S
        return Events((left + early, right + early), (left_off - late, right_off - late))

    def each(self, function: Callable[[Floats], Floats]) -> Events:
        """Return the events with a function applied to the times of each kind."""
        (left, right), (left_off, right_off) = self
        return Events((function(left), function(right)), (function(left_off), function(right_off)))

    def less(self, reference: Events) -> tuple[float | None, float | None]:
        """Return the mean delays of strikes and of offs after the nearest events of a reference.

        Events that are more than 0.2 s from any of the reference count as missed; None without any
        pair of events.
        """
        strikes, offs = (
            np.concatenate([_delays(*pair) for pair in zip(times, references, strict=True)])
            for times, references in zip(self, reference, strict=True)
        )
        return _mean(strikes), _mean(offs)


class Cycle(NamedTuple):
    """The events of one stride [s], in the order of a normal walk."""

    side: int
    """Side of the foot: 0 is left, 1 is right."""
    strike: float
    opposite_off: float
    opposite_strike: float
    off: float
    end: float
    """The next strike of the same foot."""


def zeni(t: Floats, walk: WalkOnPath) -> Events:
    """Return foot strikes and foot offs at times t (n,) [s], without a correction of their bias.

    J. A. Zeni, J. G. Richards, J. S. Higginson, Two simple methods for determining gait events
    during treadmill and overground walking using kinematic data, Gait & Posture 27, 2008: a heel
    strikes when it is farthest ahead of the pelvis, and the toes leave the floor when they are
    farthest behind it. Extrema are refined by a parabola through three samples.

    Noise shifts an extremum. So extrema are found in joints with a very low cut-off, and then
    shifted by their mean time difference from the extrema of the given joints.
    """
    rate_hz = 1.0 / float(np.mean(np.diff(t)))
    frequency = stride_frequency(walk, rate_hz)

    def farthest(joint: int, sign: float) -> Floats:
        ahead = sign * (walk.joints[:, joint, 0] - walk.joints[:, 0, 0])
        exact, steady = (
            _peaks(t, values, 0.6 * rate_hz / frequency)
            for values in (ahead, lowpass(ahead, rate_hz, STEADY_STRIDES * frequency))
        )
        delays = _delays(exact, steady)
        return steady + (delays.mean() if len(delays) else 0.0)

    left, right = (farthest(heel, 1.0) for heel in HEELS)
    left_off, right_off = (farthest(ball, -1.0) for ball in BALLS)
    return Events((left, right), (left_off, right_off))


def planted(t: Floats, joints: Floats) -> Events:
    """Return the events of true joints (n, 20, 3), from the planted feet.

    A strike is when the lowest point of a foot reaches the floor, an off when it leaves the floor.
    """
    strikes, offs = [], []
    for heel, ball in zip(HEELS, BALLS, strict=True):
        height = np.minimum(joints[:, heel, 2], joints[:, ball, 2]) - CONTACT_M
        at = np.flatnonzero((height[1:] < 0.0) != (height[:-1] < 0.0))
        times = t[at] + (t[at + 1] - t[at]) * height[at] / (height[at] - height[at + 1])
        comes = height[at] >= 0.0
        strikes.append(times[comes])
        offs.append(times[~comes])
    return Events((strikes[0], strikes[1]), (offs[0], offs[1]))


def cycles(events: Events) -> list[Cycle]:
    """Return all strides with complete events and plausible times, the left foot's first."""
    complete = []
    for side, opposite in ((0, 1), (1, 0)):
        usual = np.median(np.diff(events.strikes[side])) if len(events.strikes[side]) > 1 else 0.0
        for strike, end in pairwise(events.strikes[side].tolist()):
            time = end - strike
            if abs(time - usual) > DOUBT * usual:
                continue
            opposite_off = _only(events.offs[opposite], strike - 0.2 * time, strike + 0.45 * time)
            opposite_strike = _only(events.strikes[opposite], strike, end)
            off = _only(events.offs[side], strike + 0.4 * time, end + 0.05 * time)
            if opposite_off is not None and opposite_strike is not None and off is not None:
                complete.append(Cycle(side, strike, opposite_off, opposite_strike, off, end))
    return complete


def _delays(times: Floats, reference: Floats) -> Floats:
    """Return the delay of each time after the nearest time of a reference, if below 0.2 s."""
    if not len(reference):
        return np.empty(0)
    apart = times[:, None] - reference
    nearest: Floats = apart[np.arange(len(times)), abs(apart).argmin(axis=1)]
    return nearest[abs(nearest) < NEAR_S]


def _mean(values: Floats) -> float | None:
    return float(values.mean()) if len(values) else None


def _only(times: Floats, low: float, high: float) -> float | None:
    """Return the only time between two limits; None if there is none, or more than one."""
    inside = times[(times > low) & (times < high)]
    return float(inside[0]) if len(inside) == 1 else None


def _peaks(t: Floats, values: Floats, distance: float) -> Floats:
    """Return the times of the peaks of values, at least `distance` samples apart."""
    at: npt.NDArray[np.int64]
    at, _ = find_peaks(values, distance=max(distance, 1.0), prominence=PROMINENCE * values.std())
    before, peak, after = values[at - 1], values[at], values[at + 1]
    part = (before - after) / (2.0 * np.minimum(before - 2.0 * peak + after, -1e-12))
    return np.asarray(t[at] + part * (t[1] - t[0]))
