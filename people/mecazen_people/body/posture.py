"""A posture: the places of all joints, and the joint angles of a gait laboratory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mecazen.skeleton import INDEX
from numpy.typing import NDArray

from mecazen_people.body.norm import PELVIS_TILT

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
    """Return hip, knee and ankle angles of both legs, left first [rad], from joint centres (20, 3).

    The hip's angle is that of the thigh to the trunk's line, about the line of the hips, plus the
    pelvic tilt that a laboratory's markers include. The knee's angle is that of the shank to the
    thigh, the ankle's that of the sole to the normal of the shank. Flexion and dorsiflexion are
    positive.
    """
    across = _minus(joints[_LEGS[0][0]], joints[_LEGS[1][0]])
    width = math.sqrt(_dot(across, across))
    trunk = _minus(joints[_SPINE], joints[_PELVIS])
    forward = _cross(across, trunk)
    up = _cross(forward, across)  # forward and up are as long as |trunk| and |trunk| · width
    angles = []
    for hip, knee, ankle, heel, ball in _LEGS:
        thigh = _minus(joints[knee], joints[hip])
        shank = _minus(joints[ankle], joints[knee])
        sole = _minus(joints[ball], joints[heel])
        angles += [
            math.atan2(_dot(thigh, forward) * width, -_dot(thigh, up)) + PELVIS_TILT,
            _between(thigh, shank),
            _between(sole, shank) - math.pi / 2,
        ]
    return tuple(angles)


def _between(a: Point, b: Point) -> float:
    """Return the angle between two vectors [rad], from 0 to pi."""
    cross = _cross(a, b)
    return math.atan2(math.sqrt(_dot(cross, cross)), _dot(a, b))


def _minus(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Point, b: Point) -> Point:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
