"""Gait curves over the cycle, and how gait changes with speed, from one table."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
from mecazen.loading import load_table
from mecazen.schema import Finite, Positive, Section

from mecazen_people.spline import Spline, natural_slopes

PELVIS_TILT = math.radians(10.0)
"""Forward tilt of the pelvis that hip flexion includes [rad]; 10 ± 2 deg while walking."""
TABLE = Path(__file__).with_name("norm.toml")

Stance = Annotated[float, msgspec.Meta(ge=0.52, le=0.85)]


class Fourier:
    """A periodic function of the phase (a cycle is 1), from equidistant samples.

    Eight harmonics reproduce the angles of a recorded adult to 0.2 deg RMS.
    """

    def __init__(self, samples: Sequence[float], harmonics: int = 8) -> None:
        n = len(samples)
        self.mean = sum(samples) / n
        self.range = max(samples) - min(samples)
        self._terms = []
        for k in range(1, harmonics + 1):
            angles = [math.tau * k * i / n for i in range(n)]
            a, b = (
                2.0 / n * sum(s * f(angle) for s, angle in zip(samples, angles, strict=True))
                for f in (math.cos, math.sin)
            )
            self._terms.append((math.tau * k, a, b))

    def at(self, phase: float) -> float:
        """Return the value at a phase."""
        return self.mean + sum(
            a * math.cos(w * phase) + b * math.sin(w * phase) for w, a, b in self._terms
        )


class KeyValues(Section):
    """A periodic curve, by its values at some percentages of the gait cycle."""

    percent: Annotated[tuple[Finite, ...], msgspec.Meta(min_length=4, max_length=100)]
    deg: tuple[Finite, ...]

    def __post_init__(self) -> None:
        """Check the order."""
        if len(self.percent) != len(self.deg):
            raise ValueError("percent and deg must have the same length")
        if not all(0.0 <= a < b < 100.0 for a, b in pairwise(self.percent)):
            raise ValueError("percent must increase, from 0 to below 100")

    def curve(self) -> Fourier:
        """Return the periodic cubic spline through the values [rad], of the phase."""
        # over three cycles, the natural ends change the middle cycle by less than rounding
        cycles = (-100.0, 0.0, 100.0)
        knots = [percent + cycle for cycle in cycles for percent in self.percent]
        values = [math.radians(deg) for _ in cycles for deg in self.deg]
        spline = Spline(knots, values, natural_slopes(knots, values))
        return Fourier([spline.at(percent)[0] for percent in range(100)])


class Factors(NamedTuple):
    """Gait at one speed."""

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


class FactorTable(Section):
    """Columns over the speed; units in `norm.toml` and in the names."""

    speed_m_s: Annotated[tuple[Positive, ...], msgspec.Meta(min_length=2, max_length=100)]
    walk_ratio_m_min: tuple[Positive, ...]
    stance_share: tuple[Stance, ...]
    hip: tuple[Positive, ...]
    knee: tuple[Positive, ...]
    ankle: tuple[Positive, ...]
    hip_offset_deg: tuple[Finite, ...]
    knee_offset_deg: tuple[Finite, ...]
    ankle_offset_deg: tuple[Finite, ...]
    sway_m: tuple[Finite, ...]
    pelvis_rotation_deg: tuple[Finite, ...]
    pelvis_obliquity_deg: tuple[Finite, ...]
    trunk_rotation_deg: tuple[Finite, ...]
    arm_swing_deg: tuple[Finite, ...]

    def __post_init__(self) -> None:
        """Check lengths and order."""
        for name in self.__struct_fields__:
            if len(getattr(self, name)) != len(self.speed_m_s):
                raise ValueError(f"{name} must have a value for each of speed_m_s")
        if not all(a < b for a, b in pairwise(self.speed_m_s)):
            raise ValueError("speed_m_s must increase")

    def at(self, speed: float) -> Factors:
        """Return the row at a `speed` [m/s]: linear between two, else the first or the last."""
        speeds = self.speed_m_s
        i = min(max(bisect_right(speeds, speed) - 1, 0), len(speeds) - 2)
        share = min(max((speed - speeds[i]) / (speeds[i + 1] - speeds[i]), 0.0), 1.0)
        columns = (getattr(self, name) for name in Factors._fields)
        return Factors(*(c[i] + share * (c[i + 1] - c[i]) for c in columns))


class Norm(Section):
    """The gait of healthy adults."""

    speed_m_s: Positive
    stance_share: Stance
    hip: KeyValues
    knee: KeyValues
    ankle: KeyValues
    factors: FactorTable


def read_norm(file: Path) -> Norm:
    """Read a table like `norm.toml`.

    Raises:
        ConfigError: One line with the file, the key and the allowed values.
    """
    return load_table(file, Norm)
