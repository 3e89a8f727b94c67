"""Sagittal angles over the gait cycle, and their deviation from those of healthy adults."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from statistics import fmean
from typing import NamedTuple

import msgspec
import numpy as np
from mecazen.skeleton import ANGLES, SIDES
from mecazen_tools.table import Floats
from scipy.interpolate import CubicSpline

from mecazen_experiments.capture import angles
from mecazen_experiments.gait.parameters import Stride
from mecazen_experiments.gait.stages import Stage

PERCENT = np.arange(101.0)
"""Points of the gait cycle [%] at which curves have values."""
JOINTS = ("hip", "knee", "ankle")
NORM_FILE = Path(__file__).with_name("fukuchi.toml")
NORM_NOTICE = (
    "Norm: derived (averaged) from Fukuchi, Fukuchi & Duarte, PeerJ 6:e4640, 2018, "
    "doi 10.6084/m9.figshare.5722711, CC BY 4.0"
)

MeanSd = tuple[float, float]
"""Mean and standard deviation between people."""


class NormAtSpeed(msgspec.Struct, frozen=True):
    """Parameters of healthy adults at one speed."""

    name: str
    speed_m_s: MeanSd
    stance_percent: MeanSd
    double_support_percent: MeanSd
    cadence_per_min: MeanSd
    step_length_m: MeanSd


class NormCurves(msgspec.Struct, frozen=True):
    """Angles of healthy adults at some points of the gait cycle [%], by joint."""

    speed_m_s: float
    percent: tuple[float, ...]
    deg: dict[str, tuple[float, ...]]
    sd_deg: dict[str, tuple[float, ...]]

    def at_all(self, values: Sequence[float]) -> Floats:
        """Return values at `PERCENT` (101,): a periodic cubic spline."""
        spline = CubicSpline((*self.percent, 100.0), (*values, values[0]), bc_type="periodic")
        curve: Floats = spline(PERCENT)
        return curve


class Norm(msgspec.Struct, frozen=True):
    """Parameters and curves of healthy adults."""

    speeds: tuple[NormAtSpeed, ...]
    curves: NormCurves

    def nearest(self, speed_m_s: float) -> NormAtSpeed:
        """Return the parameters at the nearest speed."""
        return min(self.speeds, key=lambda one: abs(one.speed_m_s[0] - speed_m_s))


@cache
def norm() -> Norm:
    """Return the norm by Fukuchi et al."""
    return msgspec.convert(tomllib.loads(NORM_FILE.read_text("utf-8")), Norm)


class Curve(NamedTuple):
    """An angle of one side over the gait cycle [deg], at `PERCENT`."""

    mean: Floats
    sd: Floats
    """Standard deviation between strides; 0 for a single stride."""
    strides: int


def curves(stage: Stage) -> dict[tuple[str, str], Curve]:
    """Return the curves of a stage by side and joint; none without strides."""
    if not stage.strides:
        return {}
    of_all = angles(stage.joints)
    known = ~np.isnan(of_all).any(axis=1)
    found = {}
    for side in SIDES:
        own = [stride for stride in stage.strides if stride.side == side]
        for joint in JOINTS:
            values = of_all[known, ANGLES.index(f"{side}_{joint}")]
            each = [np.interp(_times(one), stage.t[known], values) for one in own]
            if each:
                found[side, joint] = Curve(np.mean(each, axis=0), np.std(each, axis=0), len(each))
    return found


def _times(stride: Stride) -> Floats:
    return stride.start_s + PERCENT / 100.0 * (stride.end_s - stride.start_s)


class Variables(msgspec.Struct, frozen=True):
    """Gait variable scores (GVS) of the three sagittal angles of one side [deg].

    R. Baker et al., The Gait Profile Score and Movement Analysis Profile, Gait & Posture 30, 2009.
    """

    hip: float
    knee: float
    ankle: float

    @property
    def sagittal_gps(self) -> float:
        """The sagittal GPS (3 of 9 variables); it differs from the GPS, which needs all nine."""
        return math.sqrt(fmean(value**2 for value in msgspec.structs.astuple(self)))


def variable_scores(found: dict[tuple[str, str], Curve]) -> dict[str, Variables]:
    """Return the scores by side: root mean square distances from the norm at 51 points."""
    scores = {}
    for side in SIDES:
        if (side, JOINTS[0]) in found:
            rms = (
                np.sqrt(np.mean((found[side, joint].mean - _norm(joint))[::2] ** 2))
                for joint in JOINTS
            )
            scores[side] = Variables(*map(float, rms))
    return scores


def _norm(joint: str) -> Floats:
    of = norm().curves
    return of.at_all(of.deg[joint])
