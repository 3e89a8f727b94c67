"""The path of a walker, and their joints about it.

Forward and left are the walker's, who walks steadily and without sharp turns; the frame of the
joints is level, with the floor at z = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from mecazen.skeleton import INDEX, SIDES
from scipy.signal import butter, sosfiltfilt

from mecazen_experiments.table import Floats

MIN_SPEED_M_S = 0.1
"""A slower person does not walk."""
PATH_HZ = 0.3
"""Cut-off of the path about which a body sways and its speed pulses, once a step."""
STRIDE_HZ = 0.3, 1.6
"""Frequencies of strides, from a shuffle's to a fast walk's."""
HEELS = tuple(INDEX[f"{side}_heel"] for side in SIDES)
LATERAL = [(INDEX[f"left_{name}"], INDEX[f"right_{name}"]) for name in ("hip", "shoulder")]


class WalkOnPath(NamedTuple):
    """A walk about the walker's own path."""

    joints: Floats
    """Joints (n, 20, 3) [m]: forward and left of where the path is, and up from the floor."""
    origin: Floats
    """The path (n, 2) [m]."""
    forward: Floats
    """Its direction (n, 2), of length 1."""
    speed: float
    """Mean along the path [m/s]."""

    def about(self, joints: Floats) -> Floats:
        """Return joints (n, 20, 3) in the frame of the path about it."""
        moved = joints[..., :2] - self.origin[:, None]
        return np.stack((*_turned(moved, self.forward, -1.0), joints[..., 2]), axis=-1)

    def placed(self, joints: Floats) -> Floats:
        """Return joints about the path in the frame of the path."""
        return np.stack((*_turned(joints, self.forward, 1.0, self.origin), joints[..., 2]), axis=-1)


def lowpass(values: Floats, rate_hz: float, cutoff_hz: float) -> Floats:
    """Return columns of values (n, ...) through a second-order Butterworth, forth and back.

    It has no lag. n is at least 10.
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
    """Return the joints (n, 20, 3) of a walk about its path; None for who does not walk.

    The path is the pelvis's, low-passed; its direction is that of the walk, or against it for
    who walks backwards by the median line from right to left.
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
    walk = WalkOnPath(joints, origin, forward, float(speeds.mean()))
    return walk._replace(joints=walk.about(joints))


def stride_frequency(walk: WalkOnPath, rate_hz: float) -> float:
    """Return the strides a second: the strongest frequency of left less right foot, forward."""
    apart = walk.joints[:, HEELS[0], 0] - walk.joints[:, HEELS[1], 0]
    size = 16 * len(apart)
    power = abs(np.fft.rfft((apart - apart.mean()) * np.hanning(len(apart)), size))
    frequencies = np.fft.rfftfreq(size, 1.0 / rate_hz)
    power[(frequencies < STRIDE_HZ[0]) | (frequencies > STRIDE_HZ[1])] = 0.0
    return float(frequencies[np.argmax(power)])


def _turned(
    vectors: Floats, forward: Floats, sign: float, origin: Floats | float = 0.0
) -> tuple[Floats, Floats]:
    """Return x and y of horizontal vectors (n, k, ≥2) turned by ± the yaw of `forward`."""
    c, s = forward[:, :1], sign * forward[:, 1:]
    x, y = c * vectors[..., 0] - s * vectors[..., 1], s * vectors[..., 0] + c * vectors[..., 1]
    if isinstance(origin, float):
        return x, y
    return x + origin[:, :1], y + origin[:, 1:]
