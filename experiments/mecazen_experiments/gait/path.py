"""The path of a walker, and the walker's joints relative to it.

Forward and left are relative to the walker, who walks steadily and without sharp turns. The frame
of the joints is level, with the floor at z = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from mecazen.portable import Floats
from mecazen.skeleton import INDEX, SIDES
from mecazen_tools.table import Floats
from scipy.signal import butter, sosfiltfilt

MIN_SPEED_M_S = 0.1
"""Minimum speed of a walk."""
PATH_HZ = 0.3
"""Cut-off of the path, which removes sway and the pulsation of the speed in each step."""
STRIDE_HZ = 0.3, 1.6
"""Range of stride frequencies, from a shuffle to a fast walk."""
HEELS = tuple(INDEX[f"{side}_heel"] for side in SIDES)
LATERAL = [(INDEX[f"left_{name}"], INDEX[f"right_{name}"]) for name in ("hip", "shoulder")]


class WalkOnPath(NamedTuple):
    """A walk relative to the walker's path."""

    joints: Floats
    """Joints (n, 20, 3) [m]: forward and left of the path's point, and up from the floor."""
    origin: Floats
    """The path (n, 2) [m]."""
    forward: Floats
    """Direction of the path (n, 2), of length 1."""

    def about(self, joints: Floats) -> Floats:
        """Transform joints (n, 20, 3) from the level frame to coordinates relative to the path."""
        c, s = self.forward[:, :1], self.forward[:, 1:]
        x, y = np.moveaxis(joints[..., :2] - self.origin[:, None], -1, 0)
        return np.stack((c * x + s * y, c * y - s * x, joints[..., 2]), axis=-1)

    def placed(self, joints: Floats) -> Floats:
        """Transform joints from coordinates relative to the path to the level frame."""
        c, s = self.forward[:, :1], self.forward[:, 1:]
        x, y, z = np.moveaxis(joints, -1, 0)
        origin_x, origin_y = self.origin[:, :1], self.origin[:, 1:]
        return np.stack((c * x - s * y + origin_x, s * x + c * y + origin_y, z), axis=-1)


def lowpass(values: Floats, rate_hz: float, cutoff_hz: float) -> Floats:
    """Filter columns of values (n, ...) with a second-order Butterworth, forwards and backwards.

    The filter has no lag. n must be at least 10.
    """
    sections = butter(2, min(cutoff_hz / (rate_hz / 2.0), 0.99), output="sos")
    padding = min(len(values) - 1, round(rate_hz / cutoff_hz))
    filtered: Floats = sosfiltfilt(sections, values, axis=0, padlen=padding)
    return filtered


def leftward(joints: Floats) -> Floats:
    """Return the horizontal vectors (n, 2) [m] from right to left, by hips and shoulders."""
    lines = [joints[:, left, :2] - joints[:, right, :2] for left, right in LATERAL]
    across: Floats = np.sum(lines, axis=0)
    return across


def about_path(joints: Floats, rate_hz: float) -> WalkOnPath | None:
    """Return a walk of joints (n, 20, 3) relative to its path; None if the person does not walk.

    The path is the low-passed path of the pelvis. Its direction is that of the motion, or the
    opposite if the person walks backwards, judged by the lines from right to left.
    """
    origin = lowpass(joints[:, 0, :2], rate_hz, PATH_HZ)
    velocity = np.gradient(origin, axis=0) * rate_hz
    speeds = np.hypot(*velocity.T)
    if speeds.min() < MIN_SPEED_M_S:
        return None
    forward = velocity / speeds[:, None]
    left = leftward(joints)
    if np.median(forward[:, 0] * left[:, 1] - forward[:, 1] * left[:, 0]) < 0.0:
        forward = -forward
    walk = WalkOnPath(joints, origin, forward)
    return walk._replace(joints=walk.about(joints))


def stride_frequency(walk: WalkOnPath, rate_hz: float) -> float:
    """Return the strides per second: the strongest frequency of the forward foot distance."""
    apart = walk.joints[:, HEELS[0], 0] - walk.joints[:, HEELS[1], 0]
    size = 16 * len(apart)
    power = abs(np.fft.rfft((apart - apart.mean()) * np.hanning(len(apart)), size))
    frequencies = np.fft.rfftfreq(size, 1.0 / rate_hz)
    power[(frequencies < STRIDE_HZ[0]) | (frequencies > STRIDE_HZ[1])] = 0.0
    return float(frequencies[np.argmax(power)])
