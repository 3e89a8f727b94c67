"""Cycles at several speeds, interpolated."""

from __future__ import annotations

from typing import NamedTuple

from mecazen_target.body.cycle import SAMPLES, Cycle, solve
from mecazen_target.body.norm import Factors
from mecazen_target.body.segments import Segments
from mecazen_target.body.style import Style

SLOWEST, FASTEST, _STEP = 0.2, 2.0, 0.2  # [m/s]


class Foot(NamedTuple):
    """What a cycle says of a foot: see `cycle.Leg`."""

    pitch: float
    lift: float
    progress: float


class Lookup:
    """The gait at a speed between those that are solved: linear in speed and phase."""

    def __init__(self, style: Style, segments: Segments) -> None:
        count = round((FASTEST - SLOWEST) / _STEP) + 1
        self._cycles = [solve(style, segments, SLOWEST + i * _STEP) for i in range(count)]
        self.offset = style.offset
        self.set_speed(0.0)

    def set_speed(self, speed: float) -> None:
        """Choose the speed [m/s]; below the slowest and above the fastest solved it is these."""
        place = (min(max(speed, SLOWEST), FASTEST) - SLOWEST) / _STEP
        i = min(int(place), len(self._cycles) - 2)
        b = place - i
        low, high = self._cycles[i], self._cycles[i + 1]
        self._low, self._high, self._share = low, high, b
        a = 1.0 - b
        self.shares = (
            a * low.stance_shares[0] + b * high.stance_shares[0],
            a * low.stance_shares[1] + b * high.stance_shares[1],
        )
        self.leads = a * low.leads[0] + b * high.leads[0], a * low.leads[1] + b * high.leads[1]
        self.stride = a * low.stride + b * high.stride
        columns = zip(low.factors, high.factors, strict=True)
        self.factors = Factors._make([a * p + b * q for p, q in columns])

    def pelvis(self, phase: float) -> tuple[float, float]:
        """Return the pelvis's forward place and its height at the left leg's phase [m]."""
        low, high, b = self._low, self._high, self._share
        return (
            (1.0 - b) * _at(low.forward, phase) + b * _at(high.forward, phase),
            (1.0 - b) * _at(low.height, phase) + b * _at(high.height, phase),
        )

    def stance_pitch(self, side: int, part: float) -> float:
        """Return the pitch of a foot on the ground [rad] at a part of its stance."""
        low, high, b = self._low.legs[side][0], self._high.legs[side][0], self._share
        return (1.0 - b) * _at(low.pitch, part) + b * _at(high.pitch, part)

    def swing(self, side: int, part: float) -> Foot:
        """Return a foot in the air at a part of its swing."""
        low, high, b = self._low.legs[side][1], self._high.legs[side][1], self._share
        a = 1.0 - b
        return Foot(
            a * _at(low.pitch, part) + b * _at(high.pitch, part),
            a * _at(low.lift, part) + b * _at(high.lift, part),
            a * _at(low.progress, part) + b * _at(high.progress, part),
        )


def _at(values: list[float], part: float) -> float:
    """Return a table's value at a part of it in [0, 1]."""
    place = part * SAMPLES
    i = min(int(place), SAMPLES - 1)
    return values[i] + (place - i) * (values[i + 1] - values[i])
