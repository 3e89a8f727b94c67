"""Cycles at several speeds, interpolated."""

from __future__ import annotations

from collections.abc import Sequence

from mecazen_people.body.cycle import SAMPLES, Swings, solve
from mecazen_people.body.segments import Segments
from mecazen_people.body.style import Style

SLOWEST, FASTEST, _STEP = 0.2, 2.0, 0.2  # [m/s]


class Lookup:
    """The gait at any speed: solved cycles, interpolated linearly in speed and phase."""

    def __init__(self, style: Style, segments: Segments) -> None:
        count = round((FASTEST - SLOWEST) / _STEP) + 1
        self._cycles = [solve(style, segments, SLOWEST + i * _STEP) for i in range(count)]
        self.offset = style.offset
        self._speed = -1.0
        self.set_speed(0.0)

    def _place(self, speed: float) -> tuple[int, float]:
        place = (min(max(speed, SLOWEST), FASTEST) - SLOWEST) / _STEP
        i = min(int(place), len(self._cycles) - 2)
        return i, place - i

    def stride_at(self, speed: float) -> float:
        """Return the stride length [m] at a speed [m/s], without setting it."""
        i, b = self._place(speed)
        return (1.0 - b) * self._cycles[i].stride + b * self._cycles[i + 1].stride

    def set_speed(self, speed: float) -> None:
        """Set the speed [m/s], limited to the range of the solved cycles."""
        if speed == self._speed:
            return  # as on most ticks
        self._speed = speed
        i, b = self._place(speed)
        a = 1.0 - b
        low, high = self._cycles[i], self._cycles[i + 1]
        self._low, self._high, self._share = low, high, b
        (p, q), (r, s) = low.stance_shares, high.stance_shares
        self.shares = a * p + b * r, a * q + b * s
        (p, q), (r, s) = low.leads, high.leads
        self.leads = a * p + b * r, a * q + b * s
        self.stride = a * low.stride + b * high.stride
        self.swings = Swings._make([a * p + b * q for p, q in zip(low.swings, high.swings)])  # noqa: B905

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

    def swing(self, side: int, part: float) -> tuple[float, float, float]:
        """Return pitch, lift and progress of a foot at a part of its swing: see `cycle.Leg`."""
        low, high, b = self._low.legs[side][1], self._high.legs[side][1], self._share
        a = 1.0 - b
        return (
            a * _at(low.pitch, part) + b * _at(high.pitch, part),
            a * _at(low.lift, part) + b * _at(high.lift, part),
            a * _at(low.progress, part) + b * _at(high.progress, part),
        )


def _at(values: Sequence[float], part: float) -> float:
    """Return a table's value, interpolated at `part` of the table in [0, 1]."""
    place = part * SAMPLES
    i = min(int(place), SAMPLES - 1)
    return values[i] + (place - i) * (values[i + 1] - values[i])
