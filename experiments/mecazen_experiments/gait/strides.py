"""Foot strikes and foot offs of a walk, and its parameters, stride by stride and as means."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from statistics import fmean, stdev
from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt
import pandas as pd
from mecazen.portable import Floats
from mecazen.skeleton import SIDES
from scipy.interpolate import make_interp_spline
from scipy.signal import find_peaks

from mecazen_experiments.gait.motion import ANKLES, BALLS, HEELS, WalkOnPath, lowpass

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
STRIKE_EARLY_S, OFF_LATE_S = 0.021, 0.030
"""Mean times by which Zeni's method finds strikes too early and offs too late.

The values are from walks that no study scores; their study is at commit b049a409.
"""
MID_STANCE = 0.4, 0.6
"""Part of the stance over which the position of a standing foot is averaged."""
MID_SWING = 0.25, 0.75
"""Part of the swing in which the minimum height of the ball of the foot is searched."""
SAMPLES = 21
"""Number of samples in a part."""
PARAMETERS = {
    "speed_m_s": ("speed", "m/s", 1.0, 2),
    "cadence_per_min": ("cadence", "steps/min", 1.0, 1),
    "stride_time_s": ("stride time", "ms", 1e3, 0),
    "stride_length_m": ("stride length", "mm", 1e3, 0),
    "step_time_s": ("step time", "ms", 1e3, 0),
    "step_length_m": ("step length", "mm", 1e3, 0),
    "step_width_m": ("step width", "mm", 1e3, 0),
    "stance_percent": ("stance", "%", 1.0, 1),
    "swing_percent": ("swing", "%", 1.0, 1),
    "double_support_percent": ("double support", "%", 1.0, 1),
    "single_support_percent": ("single support", "%", 1.0, 1),
    "clearance_m": ("clearance", "mm", 1e3, 0),
}
"""The parameters of a stride, see docs/mocap.md: title, unit, scale and digits for display."""


class Events(NamedTuple):
    """Times [s] of the events of the left and of the right foot."""

    strikes: tuple[Floats, Floats]
    offs: tuple[Floats, Floats]

    def each(self, function: Callable[[Floats], Floats]) -> Events:
        """Return the events with a function applied to the times of each kind."""
        return Events(*((function(left), function(right)) for left, right in self))

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


def zeni(t: Floats, walk: WalkOnPath) -> Events:
    """Return foot strikes and foot offs at times t (n,) [s], without the method's mean errors.

    J. A. Zeni, J. G. Richards, J. S. Higginson, Two simple methods for determining gait events
    during treadmill and overground walking using kinematic data, Gait & Posture 27, 2008: a heel
    strikes when it is farthest ahead of the pelvis, and the toes leave the floor when they are
    farthest behind it. Extrema are refined by a parabola through three samples.

    Noise shifts an extremum. So extrema are found in joints with a very low cut-off, and then
    shifted by their mean time difference from the extrema of the joints themselves.
    """
    rate_hz, frequency = walk.rate_hz, walk.stride_hz

    def farthest(joint: int, sign: float, correction_s: float) -> Floats:
        ahead = sign * (walk.joints[:, joint, 0] - walk.joints[:, 0, 0])
        exact, steady = (
            _peaks(t, values, 0.6 * rate_hz / frequency)
            for values in (ahead, lowpass(ahead, rate_hz, STEADY_STRIDES * frequency))
        )
        return steady + (_mean(_delays(exact, steady)) or 0.0) + correction_s

    left, right = (farthest(heel, 1.0, STRIKE_EARLY_S) for heel in HEELS)
    left_off, right_off = (farthest(ball, -1.0, -OFF_LATE_S) for ball in BALLS)
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


def cycles(events: Events) -> list[tuple[int, float, float, float, float, float]]:
    """Return all strides with complete events and plausible times, the left foot's first.

    A stride has a side (0 is left, 1 is right) and the times of its events [s]: strike, off of the
    other foot, strike of the other foot, off, and the next strike of the same foot.
    """
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
                complete.append((side, strike, opposite_off, opposite_strike, off, end))
    return complete


def strides(
    t: Floats, joints: Floats, events: Events, seen: Floats | None = None
) -> pd.DataFrame | None:
    """Return the strides of a walk, a row each, those of the left foot first; None without any.

    The columns are the side, the times of the events, `PARAMETERS`, and the share of the frames in
    which the leg is seen. A step width is missing if the other foot's stance is not known.

    Args:
        t: Times (n,) [s], at a constant rate.
        joints: Joints (n, 20, 3) [m] in a level frame, without NaN.
        events: Strikes and offs; strides with a missing event are left out.
        seen: Whether each leg is seen (n, 2); None if both are always seen.
    """
    complete = cycles(events)
    if not complete:
        return None
    spline = make_interp_spline(t, joints, k=1)

    def during(begin: float, end: float, part: tuple[float, float], count: int) -> Floats:
        """Return the joints (count, 20, 3) [m] at even times in a part of an interval."""
        times = np.linspace(begin + part[0] * (end - begin), begin + part[1] * (end - begin), count)
        places: Floats = spline(np.clip(times, t[0], t[-1]))
        return places

    feet = [  # mean positions (2, 3) of ankle and ball in mid-stance
        during(strike, off, MID_STANCE, SAMPLES)[:, [ANKLES[side], BALLS[side]]].mean(axis=0)
        for side, strike, _, _, off, _ in complete
    ]
    rows = []
    for (side, strike, opposite_off, opposite_strike, off, end), foot in zip(
        complete, feet, strict=True
    ):
        time, share = end - strike, 1e2 / (end - strike)
        first, last = during(strike, end, (0.0, 1.0), 2)
        forward = (last - first)[0, :2]  # along the displacement of the pelvis
        forward /= math.hypot(*forward)
        heel, opposite_heel = last[HEELS[side], :2], last[HEELS[1 - side], :2]
        length = float((heel - first[HEELS[side], :2]) @ forward)
        width = None
        for step, opposite_foot in zip(complete, feet, strict=True):
            if step[0] != side and abs(step[1] - opposite_strike) < 0.1 * time:
                x, y = (foot - opposite_foot)[0, :2]
                width = float(forward[0] * y - forward[1] * x) * (1 - 2 * side)
                break
        ball = during(off, end, MID_SWING, SAMPLES)[:, BALLS[side], 2]
        frames = slice(*np.searchsorted(t, (strike, end)))
        rows.append(
            {
                "side": SIDES[side],
                "start_s": strike,
                "opposite_off_s": opposite_off,
                "opposite_strike_s": opposite_strike,
                "off_s": off,
                "end_s": end,
                "stride_time_s": time,
                "stride_length_m": length,
                "speed_m_s": length / time,
                "cadence_per_min": 120.0 / time,
                "step_time_s": end - opposite_strike,
                "step_length_m": float((heel - opposite_heel) @ forward),
                "step_width_m": width,
                "stance_percent": share * (off - strike),
                "swing_percent": share * (end - off),
                "double_support_percent": share * (opposite_off - strike + off - opposite_strike),
                "single_support_percent": share * (opposite_strike - opposite_off),
                "clearance_m": float(ball.min() - foot[1, 2]),
                "seen_percent": 1e2 if seen is None else 1e2 * float(seen[frames, side].mean()),
            }
        )
    return pd.DataFrame(rows)


class Spread(msgspec.Struct, frozen=True):
    """Mean and standard deviation of a parameter over strides."""

    mean: float
    sd: float | None
    """None for a single stride."""
    strides: int


class Gait(msgspec.Struct, frozen=True):
    """Parameters of a walk, by side and by their names in `PARAMETERS`."""

    left: dict[str, Spread]
    right: dict[str, Spread]

    def mean(self, name: str) -> float:
        """Return the mean of both sides' means."""
        return (self.left[name].mean + self.right[name].mean) / 2.0

    def difference(self, name: str) -> float:
        """Return the left mean minus the right mean."""
        return self.left[name].mean - self.right[name].mean

    def asymmetry_percent(self, name: str) -> float:
        """Return the difference left minus right over the mean of both [%]; 0 if both are 0."""
        return 1e2 * self.difference(name) / (self.mean(name) or math.inf)

    def sd(self, name: str) -> float | None:
        """Return the standard deviation between strides, combined over both sides."""
        left, right = self.left[name].sd, self.right[name].sd
        return None if left is None or right is None else math.hypot(left, right) / math.sqrt(2.0)


def summary(strides: pd.DataFrame | None) -> Gait | None:
    """Return means and deviations over strides; None without strides of both sides."""
    if strides is None:
        return None
    sides = {}
    for side in SIDES:
        rows = strides[strides["side"] == side]
        values = {name: rows[name].dropna().tolist() for name in PARAMETERS}
        if not all(values.values()):
            return None
        sides[side] = {name: _spread(column) for name, column in values.items()}
    return Gait(**sides)


def _spread(values: Sequence[float]) -> Spread:
    return Spread(fmean(values), stdev(values) if len(values) > 1 else None, len(values))


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
