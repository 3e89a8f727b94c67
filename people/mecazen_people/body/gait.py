"""How one person walks: curves of each leg, and steps, at any speed; the norm is in `norm.toml`."""

from __future__ import annotations

import math
import tomllib
from bisect import bisect_right
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy  # its parts are loaded when they are used: most people have no body
from mecazen.config.people import Body

NORM_FILE = Path(__file__).with_name("norm.toml")

_ADULT_M = 1.75  # height of the people in the norm
_DOUBLE = 0.03  # least share of the cycle between a heel strike and the other foot's toe-off
_LEG = 0.53  # length as a share of the height (Winter)
_RANGES = tuple(map(math.radians, (65.0, 85.0, 50.0)))
"""Ranges of hip, knee and ankle [rad] up to which a faster walk enlarges the ranges of a recording;
the ranges at 2 m/s are up to 53, 64 and 43 deg."""
_STANCE_KNEE = math.radians(15.0)  # flexion up to which a stiff knee is like others


class Fourier:
    """A periodic function of the phase (a cycle is 1), from equidistant samples.

    Eight harmonics reproduce the angles of a recorded adult to 0.2 deg RMS.
    """

    def __init__(self, samples: Sequence[float]) -> None:
        n = len(samples)
        self.mean = math.fsum(samples) / n
        self.range = max(samples) - min(samples)
        self._terms = []
        for k in range(1, 9):
            angles = [math.tau * k * i / n for i in range(n)]
            a, b = (
                2.0 / n * math.fsum(s * f(angle) for s, angle in zip(samples, angles, strict=True))
                for f in (math.cos, math.sin)
            )
            self._terms.append((math.tau * k, a, b))

    def at(self, phase: float) -> float:
        """Return the value at a phase."""
        return self.mean + math.fsum(
            [a * math.cos(w * phase) + b * math.sin(w * phase) for w, a, b in self._terms]
        )


LegCurves = tuple[Fourier, Fourier, Fourier]
"""Hip, knee and ankle [rad] over the phase of their leg."""


class GaitFactors(NamedTuple):
    """The norm at one speed: the columns of its table, in this order."""

    walk_ratio_m_min: float
    stance_share: float
    hip: float
    knee: float
    ankle: float
    hip_offset_deg: float
    knee_offset_deg: float
    ankle_offset_deg: float
    sway_m: float
    pelvis_rotation_deg: float
    pelvis_obliquity_deg: float
    trunk_rotation_deg: float
    arm_swing_deg: float


class Gait(NamedTuple):
    """A gait at one speed: the norm's, or a recorded one."""

    speed: float
    """[m/s]."""
    stance_shares: tuple[float, float]
    """Stance shares of the left and the right leg; all pairs have this order."""
    stride: float | None
    """Stride length [m]; None: from the walk ratio."""
    curves: tuple[LegCurves, LegCurves]
    offset: float = 0.5
    """Phase of the right leg when the left one's is 0."""


@cache
def _norm() -> dict[str, Any]:
    return tomllib.loads(NORM_FILE.read_text("utf-8"))


@cache
def normal_gait() -> Gait:
    """Return the gait of healthy adults."""
    norm = _norm()
    hip, knee, ankle = (_curve(**norm[joint]) for joint in ("hip", "knee", "ankle"))
    shares = (norm["stance_share"],) * 2
    return Gait(norm["speed_m_s"], shares, None, ((hip, knee, ankle),) * 2)


def _curve(percent: Sequence[float], deg: Sequence[float]) -> Fourier:
    """Return the periodic cubic spline through values at percentages of the gait cycle [rad]."""
    spline = scipy.interpolate.CubicSpline(
        [*percent, percent[0] + 100.0], np.radians([*deg, deg[0]]), bc_type="periodic"
    )
    return Fourier(spline(np.arange(100.0)).tolist())


def factors_at(speed: float) -> GaitFactors:
    """Return the norm at a `speed` [m/s]: linear between two rows, else the first or the last."""
    table = _norm()["factors"]
    speeds = table["speed_m_s"]
    i = min(max(bisect_right(speeds, speed) - 1, 0), len(speeds) - 2)
    share = min(max((speed - speeds[i]) / (speeds[i + 1] - speeds[i]), 0.0), 1.0)
    columns = [table[name] for name in GaitFactors._fields]
    return GaitFactors(*(c[i] + share * (c[i + 1] - c[i]) for c in columns))


class Style:
    """The gait of one person at all speeds: a gait, scaled by the norm's factors; and a pathology.

    The person's `height` is in [m]; `gait` is their own, or that of healthy adults.
    """

    def __init__(self, body: Body, height: float, gait: Gait) -> None:
        self._body, self._height, self._gait = body, height, gait
        self._size = height / _ADULT_M
        self._at_gait, self._stride_share = factors_at(gait.speed), 1.0
        self._largest_ratios = [[math.inf] * 3] * 2
        if gait.stride is not None:  # a recording, scaled to this person
            speed = gait.speed / math.sqrt(self._size)
            self._at_gait = factors_at(speed)
            self._stride_share = gait.stride / (self._size * _stride(self._at_gait, speed))
            self._largest_ratios = [
                [max(r / max(c.range, 0.01), 1.0) for r, c in zip(_RANGES, curves, strict=True)]
                for curves in gait.curves
            ]
        limp = body.limp
        affected = 1.0 if limp is not None and limp.side == "left" else -1.0
        stance, step = (0.0, 0.0) if limp is None else (limp.stance_asymmetry, limp.step_asymmetry)
        self._stance_changes = (-affected * stance / 2, affected * stance / 2)
        # with a shorter stance the other leg steps sooner, which makes steps equally long
        self.offset = gait.offset + affected * stance / 2
        self._leads = (affected * step / 8, -affected * step / 8)

    def _normal_speed(self, speed: float) -> float:
        """Return the speed at which an adult makes the steps that this person makes at `speed`.

        The walk ratio makes step lengths proportional to the root of the speed, for a shuffle.
        Small people walk like tall ones of the same Froude number (A. L. Hof, Gait & Posture 4,
        1996).
        """
        shuffle = self._body.shuffle
        share = 1.0 if shuffle is None else shuffle.step_length
        return speed * share**2 * math.sqrt(1.0 / self._size)

    def factors(self, speed: float) -> GaitFactors:
        """Return the norm's factors for a walk of this person at `speed` [m/s]."""
        return factors_at(self._normal_speed(speed))

    def stride(self, speed: float) -> float:
        """Return the stride length [m]."""
        speed = min(self._normal_speed(speed), _norm()["factors"]["speed_m_s"][-1])
        return self._size * self._stride_share * _stride(factors_at(speed), speed)

    def stance_share(self, side: int, speed: float) -> float:
        """Return the share of its cycle for which a leg (0 left, 1 right) stands."""
        ratio = self._gait.stance_shares[side] / self._at_gait.stance_share
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
        recorded = self._gait.stance_shares[side]
        if phase < share:
            warped = phase / share * recorded
        else:
            warped = recorded + (phase - share) / (1.0 - share) * (1.0 - recorded)
        ratios = [
            min(factors[2 + i] / self._at_gait[2 + i], self._largest_ratios[side][i])
            for i in range(3)
        ]
        # in a shorter stance the hip moves less far
        ratios[0] *= share / (share - self._stance_changes[side])
        hip, knee, ankle = (
            curve.mean
            + ratios[i] * (curve.at(warped) - curve.mean)
            + math.radians(factors[5 + i] - self._at_gait[5 + i])
            for i, curve in enumerate(self._gait.curves[side])
        )
        stiff = self._body.stiff_knee
        if stiff is not None and stiff.side in ("both", ("left", "right")[side]):
            knee -= (1.0 - stiff.flexion) * max(0.0, knee - _STANCE_KNEE)
        turned = self.lead(side, speed) / (_LEG * self._height)
        return hip + turned, knee, ankle - turned


def _stride(factors: GaitFactors, speed: float) -> float:
    """Return the stride length [m]: twice the step length sqrt(60·walk ratio·speed)."""
    return 2.0 * math.sqrt(60.0 * factors.walk_ratio_m_min * speed)
