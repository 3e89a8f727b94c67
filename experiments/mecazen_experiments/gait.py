"""Gait events and spatio-temporal parameters from the joints of a walker.

Forward and left are the walker's, who walks steadily and without sharp turns; the frame of the
joints is level, with the floor at z = 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt
from mecazen.skeleton import INDEX, SIDES
from scipy.signal import butter, find_peaks, sosfiltfilt

from mecazen_experiments.table import Floats

MIN_SPEED_M_S = 0.1
"""A slower person does not walk."""
PATH_HZ = 0.3
"""Cut-off of the path about which a body sways and its speed pulses, once a step."""
STRIDE_HZ = 0.3, 1.6
"""Frequencies of strides, from a shuffle's to a fast walk's."""
PROMINENCE = 0.3
"""Prominence of an event's extremum, in standard deviations of its signal."""
CONTACT_M = 0.001
"""Height of a true foot's lowest point below which it stands on the floor."""
HEELS, BALLS = (tuple(INDEX[f"{side}_{name}"] for side in SIDES) for name in ("heel", "foot"))
LATERAL = [(INDEX[f"left_{name}"], INDEX[f"right_{name}"]) for name in ("hip", "shoulder")]


class Gait(msgspec.Struct, frozen=True):
    """Spatio-temporal parameters of a walk."""

    stride_time_s: float
    stride_length_m: float
    cadence_per_min: float
    """Steps, of which a stride has two."""
    stance_share: float
    """Share of the stride; mean of both legs."""
    step_time_asymmetry: float
    """Left less right step time over their mean; the left step ends with the left heel strike."""
    step_length_asymmetry: float
    """The same of the step lengths."""
    stance_asymmetry: float
    """Left less right stance, as shares of the stride."""


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


Events = tuple[Floats, Floats, Floats, Floats]
"""Times [s] of what happens once in each stride: left and right strikes, left and right offs."""


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


def events(t: Floats, walk: WalkOnPath) -> Events:
    """Return heel strikes and toe-offs at times t (n,) [s].

    J. A. Zeni, J. G. Richards, J. S. Higginson, Two simple methods for determining gait events
    during treadmill and overground walking using kinematic data, Gait & Posture 27, 2008: a heel
    strikes when it is farthest ahead of the pelvis, and the toes leave the floor when they are
    farthest behind it. Extrema are refined by a parabola through three samples.
    """
    rate_hz = 1.0 / float(np.mean(np.diff(t)))
    least = 0.6 * rate_hz / stride_frequency(walk, rate_hz)
    pelvis = walk.joints[:, 0, 0]
    strikes = [_peaks(t, walk.joints[:, heel, 0] - pelvis, least) for heel in HEELS]
    offs = [_peaks(t, pelvis - walk.joints[:, ball, 0], least) for ball in BALLS]
    return strikes[0], strikes[1], offs[0], offs[1]


def rhythm(found: Events, period: float) -> tuple[float, tuple[float, ...]] | None:
    """Return the mean stride time [s], and when left and right strike and left and right lift off.

    All events of a steady walk are offset + k · stride time: one least-squares fit gives them.
    `period` is a first guess of it. None if an event is not there twice.
    """
    if min(map(len, found)) < 2:
        return None
    rows, times = [], []
    for kind, train in enumerate(found):
        for time in train:
            row = [0.0] * (len(found) + 1)
            row[kind], row[-1] = 1.0, round((time - train[0]) / period)
            rows.append(row)
            times.append(time)
    *offsets, stride = np.linalg.lstsq(np.array(rows), np.array(times), rcond=None)[0].tolist()
    return stride, tuple(offsets)


def parameters(t: Floats, walk: WalkOnPath) -> Gait | None:
    """Return the parameters of a walk by its events; None without two of each."""
    found = events(t, walk)
    rate_hz = 1.0 / float(np.mean(np.diff(t)))
    fitted = rhythm(found, 1.0 / stride_frequency(walk, rate_hz))
    if fitted is None:
        return None
    stride, offsets = fitted
    return gait(stride, offsets, walk.speed, step_lengths(walk, rate_hz))


def step_lengths(walk: WalkOnPath, rate_hz: float) -> tuple[float, float]:
    """Return the mean length [m] of the left and of the right step.

    The ball of the foot that is left behind lifts off last, so both balls stand when they are
    farthest apart.
    """
    apart = walk.joints[:, BALLS[0], 0] - walk.joints[:, BALLS[1], 0]
    size = round(rate_hz / stride_frequency(walk, rate_hz))
    strides = apart[: len(apart) // size * size].reshape(-1, size)
    return float(strides.max(axis=1).mean()), float(-strides.min(axis=1).mean())


def gait(
    stride: float, offsets: tuple[float, ...], speed: float, steps: tuple[float, float]
) -> Gait:
    """Return the parameters of strides that take `stride` [s] at a speed [m/s].

    `offsets` are those of `rhythm`, and `steps` those of `step_lengths`.
    """
    left, right, left_off, right_off = offsets
    stances = [
        math.fmod(off - on, stride) % stride for off, on in ((left_off, left), (right_off, right))
    ]
    left_step = (left - right) % stride
    return Gait(
        stride,
        speed * stride,
        120.0 / stride,
        sum(stances) / 2.0 / stride,
        (2.0 * left_step - stride) / (stride / 2.0),
        2.0 * (steps[0] - steps[1]) / (steps[0] + steps[1]),
        (stances[0] - stances[1]) / stride,
    )


def true_gait(t: Floats, joints: Floats) -> Gait | None:
    """Return the parameters of true joints (n, 20, 3) by their planted feet.

    A foot is down from when its lowest point comes to the floor until it leaves it; a stride is as
    long as the way between the heel's places at two strikes of the same foot.
    """
    strikes, offs, ways = [], [], []
    for heel, ball in zip(HEELS, BALLS, strict=True):
        height = np.minimum(joints[:, heel, 2], joints[:, ball, 2])
        down = height < CONTACT_M
        on = np.flatnonzero(down[1:] & ~down[:-1]) + 1
        off = np.flatnonzero(~down[1:] & down[:-1])
        strikes.append(t[on])
        offs.append(t[off])
        ways += np.hypot(*np.diff(joints[on, heel, :2], axis=0).T).tolist()
    if min(map(len, (*strikes, *offs))) < 2:
        return None
    rate_hz = 1.0 / float(np.mean(np.diff(t)))
    walk = about_path(joints, rate_hz)
    if walk is None:
        return None
    period = float(np.median(np.diff(strikes[0])))
    fitted = rhythm((strikes[0], strikes[1], offs[0], offs[1]), period)
    assert fitted is not None
    stride, offsets = fitted
    return gait(stride, offsets, float(np.mean(ways)) / stride, step_lengths(walk, rate_hz))


def _turned(
    vectors: Floats, forward: Floats, sign: float, origin: Floats | float = 0.0
) -> tuple[Floats, Floats]:
    """Return x and y of horizontal vectors (n, k, ≥2) turned by ± the yaw of `forward`."""
    c, s = forward[:, :1], sign * forward[:, 1:]
    x, y = c * vectors[..., 0] - s * vectors[..., 1], s * vectors[..., 0] + c * vectors[..., 1]
    if isinstance(origin, float):
        return x, y
    return x + origin[:, :1], y + origin[:, 1:]


def _peaks(t: Floats, values: Floats, distance: float) -> Floats:
    """Return when values are largest, at least `distance` samples apart."""
    found: npt.NDArray[np.int64]
    found, _ = find_peaks(values, distance=max(distance, 1.0), prominence=PROMINENCE * values.std())
    before, at, after = values[found - 1], values[found], values[found + 1]
    part = (before - after) / (2.0 * np.minimum(before - 2.0 * at + after, -1e-12))
    return np.asarray(t[found] + part * (t[1] - t[0]))
