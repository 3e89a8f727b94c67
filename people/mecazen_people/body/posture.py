"""The shape of a body, its posture, and the joint angles of a gait laboratory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from mecazen.skeleton import INDEX
from numpy.typing import NDArray

PELVIS_TILT = math.radians(10.0)
"""Forward tilt of the pelvis that hip flexion includes [rad]; 10 ± 2 deg while walking."""

Point = tuple[float, float, float]

_PELVIS, _SPINE = INDEX["pelvis"], INDEX["spine"]
_LEGS = tuple(
    tuple(INDEX[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle", "heel", "foot"))
    for side in ("left", "right")
)


class Segments(NamedTuple):
    """Lengths [m]."""

    thigh: float
    shank: float
    ankle: float
    """Height of the ankle above the sole."""
    heel: float
    """Distance from the point below the ankle back to the heel."""
    ball: float
    """Distance from the point below the ankle forward to the ball of the foot."""
    hips: float
    """Distance between the hip joints' centres."""
    step_width: float
    trunk: float
    """Distance from the middle of the hips to the height of the shoulders."""
    head: float
    """Distance from the height of the shoulders to the middle of the head."""
    shoulders: float
    upper_arm: float
    forearm: float

    @classmethod
    def from_height(cls, height: float) -> Segments:
        """Return the segments of a person of a `height` [m].

        Shares of the height by R. Drillis and R. Contini, Body segment parameters (1966), in D. A.
        Winter, Biomechanics and Motor Control of Human Movement (2009), fig. 4.1. The hip width
        there is that of the skin; the joints are 0.167 m apart in a person of 1.80 m (S. L. Delp et
        al., IEEE Trans. Biomed. Eng. 37, 1990). The foot's length is 0.152; the heel is a quarter
        of it behind the ankle, the ball half of it ahead. Steps are 0.1 m wide.
        """
        shares = (0.245, 0.246, 0.039, 0.037, 0.075, 0.093, 0.057, 0.288, 0.117, 0.259)
        return cls(*(height * share for share in (*shares, 0.186, 0.146)))

    @property
    def standing(self) -> float:
        """Height of the hips of a standing person, with the knees bent by 8 deg."""
        return 0.9976 * (self.thigh + self.shank) + self.ankle

    def roll(self, pitch: float) -> tuple[float, float]:
        """Return x and z of a standing foot's ankle, from the point below the flat foot's ankle.

        The foot turns by `pitch` [rad], toes up if positive, about the heel, else about the ball.
        """
        c, s = math.cos(pitch), math.sin(pitch)
        lever = -self.heel if pitch >= 0.0 else self.ball
        return lever * (1.0 - c) - self.ankle * s, self.ankle * c - lever * s


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
