"""How one person walks: curves of each leg, and steps, at any speed."""

from __future__ import annotations

import math
from typing import NamedTuple

from mecazen_target.body.norm import Factors, FactorTable, Fourier, Norm
from mecazen_target.config import Body

_STANCE_KNEE = math.radians(15.0)  # a stiff knee's flexion up to which it is as others


class Reference(NamedTuple):
    """A gait at one speed."""

    speed: float
    """[m/s]."""
    stance_shares: tuple[float, float]
    """Of the left and the right leg, as all pairs."""
    stride: float | None
    """Stride length [m]; None is that of the walk ratio."""
    curves: tuple[tuple[Fourier, Fourier, Fourier], tuple[Fourier, Fourier, Fourier]]
    """Hip, knee and ankle [rad] over the phase of their leg."""


def reference(norm: Norm) -> Reference:
    """Return the table's own gait."""
    curves = (norm.hip.curve(), norm.knee.curve(), norm.ankle.curve())
    return Reference(norm.speed_m_s, (norm.stance_share,) * 2, None, (curves, curves))


class Style:
    """The gait of one person at all speeds: a reference, scaled by factors, and its pathology."""

    def __init__(self, body: Body, factors: FactorTable, gait: Reference) -> None:
        self._body, self._gait, self._factors = body, gait, factors
        self._own = factors.at(gait.speed)
        self._stride_share = 1.0
        if gait.stride is not None:
            self._stride_share = gait.stride / _stride(self._own, gait.speed)
        limp = body.limp
        affected = 1.0 if limp is not None and limp.side == "left" else -1.0
        a, q = (0.0, 0.0) if limp is None else (limp.stance_asymmetry, limp.step_asymmetry)
        self._stance_changes = (-affected * a / 2, affected * a / 2)
        self.offset = 0.5 - affected * a / 2
        """Phase of the right leg when the left one's is 0: a shorter stance is a sooner step."""
        self._leads = (affected * q / 4, -affected * q / 4)

    def _slower(self, speed: float) -> float:
        """Return the speed at which others make the steps that this person makes at `speed`."""
        shuffle = self._body.shuffle
        # the walk ratio makes step lengths proportional to the root of the speed
        return speed if shuffle is None else speed * shuffle.step_length**2

    def factors(self, speed: float) -> Factors:
        """Return the row of the table for a walk at `speed` [m/s]."""
        return self._factors.at(self._slower(speed))

    def stride(self, speed: float) -> float:
        """Return the stride length [m]."""
        slower = self._slower(speed)
        return self._stride_share * _stride(self._factors.at(slower), slower)

    def stance_share(self, side: int, speed: float) -> float:
        """Return the share of its cycle for which a leg (0 left, 1 right) stands."""
        ratio = self._gait.stance_shares[side] / self._own.stance_share
        share = ratio * self.factors(speed).stance_share + self._stance_changes[side]
        return min(max(share, 0.52), 0.85)

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
        hip, knee, ankle = (
            curve.mean
            + (factors[2 + i] / self._own[2 + i]) * (curve.at(warped) - curve.mean)
            + math.radians(factors[5 + i] - self._own[5 + i])
            for i, curve in enumerate(self._gait.curves[side])
        )
        stiff = self._body.stiff_knee
        if stiff is not None and stiff.side in ("both", ("left", "right")[side]):
            knee -= (1.0 - stiff.flexion) * max(0.0, knee - _STANCE_KNEE)
        return hip, knee, ankle


def _stride(factors: Factors, speed: float) -> float:
    """Return the stride length [m]: twice the step length sqrt(60·walk ratio·speed)."""
    return 2.0 * math.sqrt(60.0 * factors.walk_ratio_m_min * speed)
