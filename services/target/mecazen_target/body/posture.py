"""A posture: where all joints are, and the angles that a gait laboratory takes from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mecazen.skeleton import INDEX
from numpy.typing import NDArray

from mecazen_target.body.norm import PELVIS_TILT

Point = tuple[float, float, float]

_PELVIS, _SPINE = INDEX["pelvis"], INDEX["spine"]
_LEGS = tuple(
    tuple(INDEX[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle", "heel", "foot"))
    for side in ("left", "right")
)


class Posture(NamedTuple):
    """The body at one time."""

    joints: NDArray[np.float64]
    """Joint centres (20, 3) in the world [m], in the order of `mecazen.skeleton.JOINTS`; the ground
    is z = 0."""
    angles: tuple[float, ...]
    """Sagittal angles (6) in the order of `mecazen.skeleton.ANGLES` [rad]."""
    phases: tuple[float, float]
    """Share in [0, 1) of the gait cycle since heel strike, of the left and the right leg."""
    standing: tuple[bool, bool]
    """Whether the left and the right foot are on the ground."""


def sagittal_angles(joints: Sequence[Point]) -> tuple[float, ...]:
    """Return hip, knee and ankle of the left and the right leg [rad] from joint centres (20, 3).

    The hip's is the thigh's about the line of the hips, from the trunk's line, plus the pelvic tilt
    that a laboratory's markers include. The knee's is the shank's from the thigh's; the ankle's is
    the sole's from the normal to the shank. Flexion and dorsiflexion are positive.
    """
    across = _unit(_minus(joints[_LEGS[0][0]], joints[_LEGS[1][0]]))
    angles = []
    for hip, knee, ankle, heel, ball in _LEGS:
        thigh = _minus(joints[knee], joints[hip])
        shank = _minus(joints[ankle], joints[knee])
        sole = _minus(joints[ball], joints[heel])
        trunk = _minus(joints[_PELVIS], joints[_SPINE])
        flexion = _turned(trunk, thigh, across)
        axis = _unit(_without(across, thigh))
        below = _unit(shank)
        along = _dot(sole, below)
        aside = _without(sole, below)
        ankle_angle = -math.atan2(along, math.sqrt(_dot(aside, aside)))
        angles += [flexion + PELVIS_TILT, -_turned(thigh, shank, axis), ankle_angle]
    return tuple(angles)


def _turned(a: Point, b: Point, axis: Point) -> float:
    """Return the angle from `a` to `b` about an axis to the left, positive as `b` goes forward."""
    b = _without(b, axis)
    a = _without(a, axis)
    return -math.atan2(_dot(_cross(a, b), axis), _dot(a, b))


def _minus(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Point, b: Point) -> Point:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _unit(a: Point) -> Point:
    length = math.sqrt(_dot(a, a))
    return a[0] / length, a[1] / length, a[2] / length


def _without(a: Point, b: Point) -> Point:
    """Return the part of `a` that is normal to `b`."""
    share = _dot(a, b) / _dot(b, b)
    return a[0] - share * b[0], a[1] - share * b[1], a[2] - share * b[2]
