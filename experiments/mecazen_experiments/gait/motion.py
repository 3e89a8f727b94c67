"""Joints over time as a body tracker reports them, and a walker's joints relative to their path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen import messages as m
from mecazen.skeleton import INDEX, JOINTS, SIDES
from mecazen_people.body.posture import sagittal_angles
from mecazen_tools.table import Bools, Floats, Poses
from scipy.signal import butter, sosfiltfilt

SEEN = 2
"""Confidence of a joint that is in view and not hidden."""
MIN_SPEED_M_S = 0.1
"""Minimum speed of a walk."""
PATH_HZ = 0.3
"""Cut-off of the path, which removes sway and the pulsation of the speed in each step."""
STRIDE_HZ = 0.3, 1.6
"""Range of stride frequencies, from a shuffle to a fast walk."""
HIPS, SHOULDERS, ANKLES, HEELS, BALLS = (
    [INDEX[f"{side}_{name}"] for side in SIDES]
    for name in ("hip", "shoulder", "ankle", "heel", "foot")
)
LEGS = [[INDEX[f"{s}_{name}"] for name in ("knee", "ankle", "heel", "foot")] for s in SIDES]
"""The joints of each leg that swing."""
MEASURED = ("hip", "knee", "ankle")
"""Joints of each side whose angle is measured, in the order of `mecazen.skeleton.ANGLES`."""


class Motion(NamedTuple):
    """Joints over time, in a fixed, level frame; the floor is at z = 0.

    In frames without a reported body, joints are NaN and confidence is 0.
    """

    t: Floats
    """Times (n,) [s]."""
    joints: Floats
    """Positions (n, 20, 3) [m], in the order of `mecazen.skeleton.JOINTS`."""
    std: Floats
    """Reported standard deviation of each joint (n, 20) along any axis [m]."""
    confidence: npt.NDArray[np.int64]
    """Confidence as in `messages.Skeleton` (n, 20)."""

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return 1.0 / float(np.mean(np.diff(self.t)))

    @property
    def reported(self) -> Bools:
        """Whether a body was reported (n,)."""
        return ~np.isnan(self.joints[:, 0, 0])

    def where(self, rows: npt.NDArray[Any]) -> Motion:
        """Return some of the frames."""
        return Motion(*(values[rows] for values in self))

    def evenly(self) -> Motion:
        """Return the frames at a constant rate; missing frames have no body."""
        period = float(np.median(np.diff(self.t)))
        at = np.rint((self.t - self.t[0]) / period).astype(np.int64)
        columns = [self.t[0] + period * np.arange(at[-1] + 1)]
        for values, missing in zip(self[1:], (np.nan, 0.0, 0), strict=True):
            columns.append(np.full((len(columns[0]), *values.shape[1:]), missing))
            columns[-1][at] = values
        return Motion(*columns)

    def placed(self, robot: Poses) -> Motion:
        """Transform joints from the robot's frame to the frame of its poses, one pose per frame."""
        c, s = np.cos(robot.yaw)[:, None], np.sin(robot.yaw)[:, None]
        x, y, z = np.moveaxis(self.joints, -1, 0)
        joints = (robot.x[:, None] + c * x - s * y, robot.y[:, None] + s * x + c * y, z)
        return self._replace(joints=np.stack(joints, axis=-1))


def motions(bodies: Sequence[m.Skeleton], frames: Sequence[m.Skeletons]) -> tuple[Motion, Motion]:
    """Return the true joints, and the first body of each frame in the frame's coordinates."""
    # frames taken before the start have no stamp
    stamped = [frame for frame in frames if frame.header.stamp.ns]
    first = [(frame.header, next(iter(frame.skeletons), None)) for frame in stamped]
    return _motion([(body.header, body) for body in bodies]), _motion(first)


def _motion(bodies: Sequence[tuple[m.Header, m.Skeleton | None]]) -> Motion:
    n = len(JOINTS)
    nobody = [[np.nan] * 3] * n
    return Motion(
        np.array([header.stamp.ns / 1e9 for header, _ in bodies]),
        np.array([[(j.x, j.y, j.z) for j in b.joints] if b else nobody for _, b in bodies]),
        np.array([b.std if b and b.std else [0.0] * n for _, b in bodies]),
        np.array([b.confidence if b and b.confidence else [0] * n for _, b in bodies]),
    )


def angles(joints: Floats) -> Floats:
    """Return the sagittal angles (n, 6) [deg] of joints (n, 20, 3), as `sagittal_angles`."""
    return np.degrees([sagittal_angles(frame) for frame in joints.tolist()])


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
    lines = [joints[:, left, :2] - joints[:, right, :2] for left, right in (HIPS, SHOULDERS)]
    across: Floats = np.sum(lines, axis=0)
    return across


class WalkOnPath(NamedTuple):
    """A steady walk without sharp turns, relative to the walker's path."""

    joints: Floats
    """Joints (n, 20, 3) [m]: forward and left of the path's point, and up from the floor."""
    origin: Floats
    """The path (n, 2) [m]."""
    forward: Floats
    """Direction of the path (n, 2), of length 1."""
    rate_hz: float

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

    @property
    def stride_hz(self) -> float:
        """Strides per second: the strongest frequency of the forward foot distance."""
        apart = self.joints[:, HEELS[0], 0] - self.joints[:, HEELS[1], 0]
        size = 16 * len(apart)
        power = abs(np.fft.rfft((apart - apart.mean()) * np.hanning(len(apart)), size))
        frequencies = np.fft.rfftfreq(size, 1.0 / self.rate_hz)
        power[(frequencies < STRIDE_HZ[0]) | (frequencies > STRIDE_HZ[1])] = 0.0
        return float(frequencies[np.argmax(power)])


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
    walk = WalkOnPath(joints, origin, forward, rate_hz)
    return walk._replace(joints=walk.about(joints))
