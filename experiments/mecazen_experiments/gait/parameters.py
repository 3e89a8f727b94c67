"""Spatio-temporal parameters of a walk, stride by stride, and their means and deviations."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from statistics import fmean, stdev
from typing import NamedTuple

import msgspec
import numpy as np
from mecazen.portable import Floats
from mecazen.skeleton import INDEX, SIDES
from scipy.interpolate import make_interp_spline

from mecazen_experiments.gait.events import BALLS, Cycle, Events, cycles
from mecazen_experiments.gait.path import HEELS

ANKLES = tuple(INDEX[f"{side}_ankle"] for side in SIDES)
MID_STANCE = 0.4, 0.6
"""Part of the stance over which the position of a standing foot is averaged."""
MID_SWING = 0.25, 0.75
"""Part of the swing in which the minimum height of the ball of the foot is searched."""
SAMPLES = 21
"""Number of samples in a part."""


class Stride(msgspec.Struct, frozen=True):
    """A stride: from a strike of a foot to the next strike of the same foot.

    Forward is the displacement of the pelvis over the stride, and left is at right angles to it.
    """

    side: str
    start_s: float
    opposite_off_s: float
    opposite_strike_s: float
    off_s: float
    end_s: float
    stride_time_s: float
    stride_length_m: float
    """Forward distance from the heel at the first strike to the heel at the second strike."""
    speed_m_s: float
    """Stride length over stride time."""
    cadence_per_min: float
    """Steps per minute; a stride has two steps."""
    step_time_s: float
    """Time from the strike of the other foot to the second strike."""
    step_length_m: float
    """Forward distance from the other heel to this heel at the second strike."""
    step_width_m: float | None
    """Lateral distance between both ankles, each averaged over the middle fifth of its stance; None
    if the other foot's stance is not known."""
    stance_percent: float
    """Time from strike to off, in % of the stride."""
    swing_percent: float
    double_support_percent: float
    """Times from strike to opposite off, and from opposite strike to off."""
    single_support_percent: float
    """Swing of the other foot: from its off to its strike."""
    clearance_m: float
    """Minimum height of the ball in the middle half of swing, above its height in the middle of
    stance."""
    seen_percent: float
    """Share of the frames in which knee, ankle, heel and ball of this leg are in view."""


class Parameter(NamedTuple):
    """A parameter of `Stride`, in the form for display."""

    title: str
    unit: str
    scale: float = 1.0
    digits: int = 1


PARAMETERS = {
    "speed_m_s": Parameter("speed", "m/s", digits=2),
    "cadence_per_min": Parameter("cadence", "steps/min"),
    "stride_time_s": Parameter("stride time", "ms", 1e3, 0),
    "stride_length_m": Parameter("stride length", "mm", 1e3, 0),
    "step_time_s": Parameter("step time", "ms", 1e3, 0),
    "step_length_m": Parameter("step length", "mm", 1e3, 0),
    "step_width_m": Parameter("step width", "mm", 1e3, 0),
    "stance_percent": Parameter("stance", "%"),
    "swing_percent": Parameter("swing", "%"),
    "double_support_percent": Parameter("double support", "%"),
    "single_support_percent": Parameter("single support", "%"),
    "clearance_m": Parameter("clearance", "mm", 1e3, 0),
}


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
        both = self.left[name].sd, self.right[name].sd
        return None if None in both else math.hypot(*both) / math.sqrt(2.0)  # type: ignore[arg-type]


def strides(t: Floats, joints: Floats, events: Events, seen: Floats | None = None) -> list[Stride]:
    """Return the strides of a walk, those of the left foot first.

    Args:
        t: Times (n,) [s], at a constant rate.
        joints: Joints (n, 20, 3) [m] in a level frame, without NaN.
        events: Strikes and offs; strides with a missing event are left out.
        seen: Whether each leg is seen (n, 2); None if both are always seen.
    """
    spline = make_interp_spline(t, joints, k=1)
    complete = cycles(events)

    def during(begin: float, end: float, part: tuple[float, float], count: int) -> Floats:
        """Return the joints (count, 20, 3) [m] at even times in a part of an interval."""
        times = np.linspace(begin + part[0] * (end - begin), begin + part[1] * (end - begin), count)
        places: Floats = spline(np.clip(times, t[0], t[-1]))
        return places

    def stance(cycle: Cycle) -> Floats:
        """Return the mean positions (2, 3) of ankle and ball in mid-stance."""
        places = during(cycle.strike, cycle.off, MID_STANCE, SAMPLES)
        mean: Floats = places[:, [ANKLES[cycle.side], BALLS[cycle.side]]].mean(axis=0)
        return mean

    stances = [stance(cycle) for cycle in complete]

    def stride(cycle: Cycle, foot: Floats) -> Stride:
        side, strike, opposite_off, opposite_strike, off, end = cycle
        time, share = end - strike, 1e2 / (end - strike)
        first, last = during(strike, end, (0.0, 1.0), 2)
        forward = (last - first)[0, :2]
        forward /= math.hypot(*forward)
        heel, opposite_heel = last[HEELS[side], :2], last[HEELS[1 - side], :2]
        length = float((heel - first[HEELS[side], :2]) @ forward)
        opposite = [
            place
            for step, place in zip(complete, stances, strict=True)
            if step.side != side and abs(step.strike - opposite_strike) < 0.1 * time
        ]
        width = None
        if opposite:
            x, y = (foot - opposite[0])[0, :2]
            width = float(forward[0] * y - forward[1] * x) * (1 - 2 * side)
        ball = during(off, end, MID_SWING, SAMPLES)[:, BALLS[side], 2]
        frames = slice(*np.searchsorted(t, (strike, end)))
        return Stride(
            *(SIDES[side], strike, opposite_off, opposite_strike, off, end, time, length),
            speed_m_s=length / time,
            cadence_per_min=120.0 / time,
            step_time_s=end - opposite_strike,
            step_length_m=float((heel - opposite_heel) @ forward),
            step_width_m=width,
            stance_percent=share * (off - strike),
            swing_percent=share * (end - off),
            double_support_percent=share * (opposite_off - strike + off - opposite_strike),
            single_support_percent=share * (opposite_strike - opposite_off),
            clearance_m=float(ball.min() - foot[1, 2]),
            seen_percent=1e2 if seen is None else 1e2 * float(seen[frames, side].mean()),
        )

    return [stride(*pair) for pair in zip(complete, stances, strict=True)]


def summary(strides: Iterable[Stride]) -> Gait | None:
    """Return means and deviations over strides; None without strides of both sides."""
    by_side: dict[str, list[Stride]] = {side: [] for side in SIDES}
    for stride in strides:
        by_side[stride.side].append(stride)
    sides = {side: _spreads(rows) for side, rows in by_side.items()}
    if any(len(spreads) < len(PARAMETERS) for spreads in sides.values()):
        return None
    return Gait(**sides)


def _spreads(strides: Sequence[Stride]) -> dict[str, Spread]:
    spreads = {}
    for name in PARAMETERS:
        values = [value for stride in strides if (value := getattr(stride, name)) is not None]
        if values:
            sd = stdev(values) if len(values) > 1 else None
            spreads[name] = Spread(fmean(values), sd, len(values))
    return spreads
