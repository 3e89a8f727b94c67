"""Lengths of a body's segments from its height, and the foot that rolls on the ground."""

from __future__ import annotations

import math
from typing import NamedTuple


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
    def of(cls, height: float) -> Segments:
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
