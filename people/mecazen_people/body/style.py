"""How one person walks: curves of each leg, and steps, at any speed."""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen.config.people import Body

from mecazen_people.body.norm import Factors, FactorTable, Fourier, Norm

_ADULT_M = 1.75  # height of the people in the table
_DOUBLE = 0.03  # least share of the cycle between a heel strike and the other foot's toe-off
_LEG = 0.53  # length as a share of the height (Winter)
_RANGES = tuple(map(math.radians, (65.0, 85.0, 50.0)))
"""Ranges of hip, knee and ankle [rad] up to which a faster walk enlarges the ranges of a recording;
the ranges at 2 m/s are up to 53, 64 and 43 deg."""
_STANCE_KNEE = math.radians(15.0)  # flexion up to which a stiff knee is like others


Curves = tuple[Fourier, Fourier, Fourier]
"""Hip, knee and ankle [rad] over the phase of their leg."""


class Reference(NamedTuple):
    """A gait at one speed."""

    speed: float
    """[m/s]."""
    stance_shares: tuple[float, float]
    """Stance shares of the left and the right leg; all pairs have this order."""
    stride: float | None
    """Stride length [m]; None: from the walk ratio."""
    curves: tuple[Curves, Curves]
    offset: float = 0.5
    """Phase of the right leg when the left one's is 0."""


def reference(norm: Norm) -> Reference:
    """Return the table's own gait."""
    curves = (norm.hip.curve(), norm.knee.curve(), norm.ankle.curve())
    return Reference(norm.speed_m_s, (norm.stance_share,) * 2, None, (curves, curves))


class Style:
    """The gait of one person at all speeds: a reference, scaled by factors, and its pathology."""

    def __init__(self, body: Body, factors: FactorTable, gait: Reference) -> None:
        self._body, self._gait, self._factors = body, gait, factors
        self._size = body.height_m / _ADULT_M
        self._own, self._stride_share = factors.at(gait.speed), 1.0
        self._most_ratios = [[math.inf] * 3] * 2
        if gait.stride is not None:  # a recording, scaled to this person
            self._own = factors.at(gait.speed / math.sqrt(self._size))
            own_stride = _stride(self._own, gait.speed / math.sqrt(self._size))
            self._stride_share = gait.stride / (self._size * own_stride)
            self._most_ratios = [
                [max(most / max(c.range, 0.01), 1.0) for most, c in zip(_RANGES, curves)]  # noqa: B905
                for curves in gait.curves
            ]
        limp = body.limp
        affected = 1.0 if limp is not None and limp.side == "left" else -1.0
        a, q = (0.0, 0.0) if limp is None else (limp.stance_asymmetry, limp.step_asymmetry)
        self._stance_changes = (-affected * a / 2, affected * a / 2)
        # with a shorter stance the other leg steps sooner, which makes steps equally long
        self.offset = gait.offset + affected * a / 2
        self._leads = (affected * q / 8, -affected * q / 8)

    def _slower(self, speed: float) -> float:
        """Return the speed at which an adult makes the steps that this person makes at `speed`.

        The walk ratio makes step lengths proportional to the root of the speed, for a shuffle.
        Small people walk like tall ones of the same Froude number (A. L. Hof, Gait & Posture 4,
        1996).
        """
        shuffle = self._body.shuffle
        share = 1.0 if shuffle is None else shuffle.step_length
        return speed * share**2 * math.sqrt(1.0 / self._size)

    def factors(self, speed: float) -> Factors:
        """Return the row of the table for a walk at `speed` [m/s]."""
        return self._factors.at(self._slower(speed))

    def stride(self, speed: float) -> float:
        """Return the stride length [m]."""
        slower = min(self._slower(speed), self._factors.speed_m_s[-1])
        return self._size * self._stride_share * _stride(self._factors.at(slower), slower)

    def stance_share(self, side: int, speed: float) -> float:
        """Return the share of its cycle for which a leg (0 left, 1 right) stands."""
        ratio = self._gait.stance_shares[side] / self._own.stance_share
        share = ratio * self.factors(speed).stance_share + self._stance_changes[side]
        # one foot is put down before the other one leaves the ground
        least = _DOUBLE + (self.offset if side else 1.0 - self.offset)
        return min(max(share, least), 0.85)

    def lead(self, side: int, speed: float) -> float:
        """Return how far ahead of the symmetrical place a foot is put down [m]."""
        return self._leads[side] * self.stride(speed)

    def angles(self, side: int, speed: float, phase: float) -> tuple[float, float, float]:
        """Return hip, knee and ankle [rad] of a leg at its phase in [0, 1)."""
        factors, share = self.factors(speed), self.stance_share(side, speed)
        own = self._gait.stance_shares[side]
        if phase < share:
            warped = phase / share * own
        else:
            warped = own + (phase - share) / (1.0 - share) * (1.0 - own)
        most = self._most_ratios[side]
        ratios = [min(factors[2 + i] / self._own[2 + i], most[i]) for i in range(3)]
        ratios[0] *= share / (
            share - self._stance_changes[side]
        )  # in a shorter stance the hip moves less far
        hip, knee, ankle = (
            curve.mean
            + ratios[i] * (curve.at(warped) - curve.mean)
            + math.radians(factors[5 + i] - self._own[5 + i])
            for i, curve in enumerate(self._gait.curves[side])
        )
        stiff = self._body.stiff_knee
        if stiff is not None and stiff.side in ("both", ("left", "right")[side]):
            knee -= (1.0 - stiff.flexion) * max(0.0, knee - _STANCE_KNEE)
        turned = self.lead(side, speed) / (_LEG * self._body.height_m)
        return hip + turned, knee, ankle - turned


def _stride(factors: Factors, speed: float) -> float:
    """Return the stride length [m]: twice the step length sqrt(60·walk ratio·speed)."""
    return 2.0 * math.sqrt(60.0 * factors.walk_ratio_m_min * speed)
