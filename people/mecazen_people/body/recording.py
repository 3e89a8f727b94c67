"""A recorded walk becomes a gait: curves over the mean cycle, stance, stride and speed."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
from mecazen.errors import ConfigError
from mecazen.portable import arctan2
from numpy.typing import NDArray

from mecazen_people.body.files import Array, MotionFile, read
from mecazen_people.body.gait import Fourier, Gait, LegCurves
from mecazen_people.body.posture import PELVIS_TILT, Segments

_NAMES = {
    "hip": ("{}Hip", "{}.HJC", "{}HJC", "{}FEP"),
    "knee": ("{}Knee", "{}.Knee", "{}KJC", "{}FEO", "{}KNE", "{}_knee"),
    "ankle": ("{}Ankle", "{}.Ankle", "{}AJC", "{}TIO", "{}ANK", "{}_ankle"),
    "toe": ("{}Ball", "{}Toe", "{}.Toe", "{}TOO", "{}TOE", "{}BigToe", "{}_toe"),
    "asis": ("{}.ASIS", "{}ASIS", "{}ASI"),
}
"""Names of points by joint, the most exact first; {} is the side. Sources:

- `{}Hip`, `{}Knee`, `{}Ankle`, `{}BigToe`: HALPE_26 of Pose2Sim (Pose2Sim.skeletons) and the video
  keypoints of OpenCap; with `{}Ball` the files of `mecazen gait --export`.
- `{}HJC`, `{}_knee`, `{}_ankle`, `{}_toe`, `{}.ASIS`: the augmented markers of OpenCap, which end
  in `_study`.
- `{}FEP`, `{}FEO`, `{}TIO`, `{}TOO`: the bones of Plug-in Gait (Vicon Nexus, Plug-in Gait bones);
  `{}KNE`, `{}ANK`, `{}TOE`, `{}ASI`: its markers; `{}HJC`, `{}KJC`, `{}AJC`: joint centres.
- `{}.HJC`, `{}.Knee`, `{}.Ankle`, `{}.Toe`, `{}.ASIS`: OpenSim's gait2392.
"""
_SIDES = (("Left", "L", "l"), ("Right", "R", "r"))
_UPRIGHT = 0.8  # least part of the way from ankles to hips along the vertical axis
_HEADING_S = 1.2  # about a stride, in which the pelvis has the mean heading of the walk
_STRAIGHTEST = np.radians(3.0)  # least flexion of the knee
_IRREGULAR = 0.3  # largest deviation of a cycle, as a share of the usual length
_FLAT = (0.3, 0.5)  # part of the stance in which the foot is taken as flat


def read_recording(file: Path, segments: Segments) -> Gait:
    """Read a recorded walk on level ground, straight on or on a treadmill.

    The result has the sagittal angles, the stance shares, the phase between the legs, and the
    stride. Heel strike is where the heel is furthest ahead of the hip, toe-off shortly before the
    ball of the foot is furthest behind (after J. A. Zeni et al., Gait & Posture 27, 2008). The
    speed is that of the standing foot relative to the hips, computed with `segments`.
    """
    motion = read(file)
    try:
        motion = motion._replace(values=_named(motion.values))
        legs = _whole(np.array([_angles(motion, side) for side in (0, 1)]))
        cycles = [_Cycles(motion.rate_hz, leg, segments) for leg in legs]
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None
    left, right = cycles
    period = (left.period + right.period) / 2
    leads = [(b - c) / (b - a) for a, b in left.cycles for c in right.strikes if a < c < b]
    leads += [(c - a) / (b - a) for a, b in right.cycles for c in left.strikes if a < c < b]
    speed = (left.speed + right.speed) / 2
    return Gait(
        speed,
        (left.share, right.share),
        speed * period,
        (left.curves, right.curves),
        min(max(float(np.median(leads or [0.5])), 0.4), 0.6),
    )


def _named(values: dict[str, Array]) -> dict[str, Array]:
    """Return values by their names without a prefix as in `Sub01:LTOE`, and without `_study`."""
    named = {name.rpartition(":")[2].removesuffix("_study"): name for name in values}
    if len(named) < len(values):
        first = next(name for name in values if name not in named.values())
        raise ConfigError(f"has two points like {first!r}; export a single person")
    return {name: values[full] for name, full in named.items()}


def _whole(angles: Array) -> Array:
    """Return the longest part without a gap of angles over frames (2, 3, n)."""
    gaps = np.flatnonzero(~np.isfinite(angles).all(axis=(0, 1)))
    edges = np.concatenate([[-1], gaps, [angles.shape[2]]])
    longest = int(np.argmax(np.diff(edges)))
    if edges[longest + 1] - edges[longest] < 3:
        raise ConfigError("must have all markers in some frames that follow each other")
    return angles[:, :, edges[longest] + 1 : edges[longest + 1]]


def _up(motion: MotionFile) -> int:
    """Return the axis that points up: from the ankles to the hips, in the mean."""
    hips = [_pelvis(motion, side) for side in (0, 1)]
    above = np.array([hip - _point(motion, "ankle", side) for side, hip in enumerate(hips)])
    mean = np.nan_to_num(above).mean(axis=(0, 1))
    up = int(np.argmax(np.abs(mean)))
    if not mean[up] > _UPRIGHT * float(np.sqrt((mean * mean).sum())):
        shown = ", ".join(f"{value:.3g}" for value in mean)
        raise ConfigError(
            f"must have x, y or z point up; its hips are [{shown}] above its ankles in the mean"
        )
    return up


def _angles(motion: MotionFile, side: int) -> Array:
    """Return hip, knee and ankle [rad] over the frames (3, n); the ankle's offset is unknown."""
    values, letter = motion.values, ("l", "r")[side]
    names = (
        *(f"{name}_{letter}" for name in ("hip_flexion", "knee_angle", "ankle_angle")),
        "pelvis_tilt",
    )
    if all(name in values and values[name].ndim == 1 for name in names):
        hip, knee, ankle, tilt = (values[name] for name in names)
        flexion = -knee if knee.mean() < 0.0 else knee  # both signs are in use
        return np.array([hip + tilt + PELVIS_TILT, flexion, ankle])
    up = _up(motion)
    near, far = (_pelvis(motion, s) for s in (side, 1 - side))
    across = (near - far) * (1 - 2 * side)
    across[:, up] = 0.0
    across = _mean_over(across, round(_HEADING_S * motion.rate_hz))
    forward = np.cross(across, np.eye(3)[up])
    length = np.sqrt((forward * forward).sum(axis=1, keepdims=True))
    if not (length > 0.0).all():
        raise ConfigError("must have its hips side by side")
    forward /= length
    knee, ankle, toe = (_point(motion, name, side) for name in ("knee", "ankle", "toe"))
    hip = _hip(motion, side, forward, up)
    if np.nansum((toe - ankle) * forward) < 0.0:
        raise ConfigError(
            "has its toes behind its ankles: left and right are swapped, or an axis is mirrored"
        )
    thigh, shank, foot = (
        np.stack([(p * forward).sum(axis=1), p[:, up]])
        for p in (knee - hip, ankle - knee, toe - ankle)
    )
    thigh_angle, shank_angle = (arctan2(x, -z) for x, z in (thigh, shank))
    pitch = arctan2(foot[1], foot[0])
    return np.array([thigh_angle + PELVIS_TILT, thigh_angle - shank_angle, pitch - shank_angle])


def _hip(motion: MotionFile, side: int, forward: Array, up: int) -> Array:
    """Return a hip joint's centre (n, 3); if it is not recorded, from the markers on the pelvis.

    The centre is 14 % of the markers' distance inwards, 19 % behind and 30 % below (A. L. Bell et
    al., J. Biomech. 23, 1990).
    """
    if _marker(motion, "hip", side) is not None:
        return _point(motion, "hip", side)
    near, far = _point(motion, "asis", side), _point(motion, "asis", 1 - side)
    width = np.sqrt(((near - far) ** 2).sum(axis=1, keepdims=True))
    down = np.eye(3)[up]
    centre: Array = near + 0.14 * (far - near) - width * (0.19 * forward + 0.30 * down)
    return centre


def _pelvis(motion: MotionFile, side: int) -> Array:
    marker = _marker(motion, "asis", side)
    return _point(motion, "hip", side) if marker is None else marker


def _mean_over(values: Array, width: int) -> Array:
    """Return the moving average of values (n, 3), over fewer values at the ends."""
    sums = np.cumsum(np.vstack([np.zeros(3), np.nan_to_num(values)]), axis=0)
    n = np.arange(len(values))
    first, last = np.maximum(n - width // 2, 0), np.minimum(n + width // 2 + 1, len(values))
    mean: Array = (sums[last] - sums[first]) / (last - first)[:, None]
    return mean


def _marker(motion: MotionFile, joint: str, side: int) -> Array | None:
    names = (name.format(text) for name in _NAMES[joint] for text in _SIDES[side])
    points = (motion.values[name] for name in names if name in motion.values)
    return next((point for point in points if point.ndim == 2), None)


def _point(motion: MotionFile, joint: str, side: int) -> Array:
    if (point := _marker(motion, joint, side)) is None:
        names = ", ".join(name.format(_SIDES[side][1]) for name in _NAMES[joint])
        raise ConfigError(f"has no point for the {_SIDES[side][0].lower()} {joint}; known: {names}")
    return point


class _Cycles:
    """The regular cycles of one leg, and their mean; pauses and single odd steps are left out."""

    def __init__(self, rate_hz: float, angles: Array, segments: Segments) -> None:
        hip, knee, ankle = angles
        thigh = hip - PELVIS_TILT
        shank = thigh - knee
        ahead = segments.thigh * np.sin(thigh) + segments.shank * np.sin(shank)
        pitch, width = shank + ankle, round(0.3 * rate_hz)
        pitch -= np.median(pitch)  # the median is about the flat foot's, see below
        heel = ahead - segments.heel * np.cos(pitch) + segments.ankle * np.sin(pitch)
        self.strikes = [_strike(heel, i, width) for i in _peaks(heel, width)]
        if len(self.strikes) < 2:
            raise ConfigError("must have a whole gait cycle of each leg")
        ball = ahead + segments.ball * np.cos(pitch) + segments.ankle * np.sin(pitch)
        every = list(pairwise(self.strikes))
        usual = sorted(b - a for a, b in every)[len(every) // 2]
        self.cycles = [(a, b) for a, b in every if abs(b - a - usual) <= _IRREGULAR * usual]
        self.period = float(np.median([b - a for a, b in self.cycles])) / rate_hz
        shares = [(_toe_off(ball, a, b) - a) / (b - a) for a, b in self.cycles]
        self.share = min(max(float(np.median(shares)), 0.52), 0.85)
        mean = np.array([self._mean(curve) for curve in angles])
        # markers beside the joints straighten a knee too far; flex it about the hip and the ankle
        flexed = max(_STRAIGHTEST - float(mean[1].min()), 0.0)
        mean[:2] += [[flexed / 2], [flexed]]
        phases = np.arange(mean.shape[1]) / mean.shape[1]
        flat = (phases > _FLAT[0] * self.share) & (phases < _FLAT[1] * self.share)
        # no file has the direction of the sole: it is level while the foot is flat
        mean[2] -= (mean[0] - PELVIS_TILT - mean[1] + mean[2])[flat].mean()
        slopes = [(ahead[b] - ahead[a]) / (b - a) for a, b in self._stances()]
        self.speed = max(-float(np.mean(slopes)) * rate_hz, 0.05)
        self.curves: LegCurves = (Fourier(mean[0]), Fourier(mean[1]), Fourier(mean[2]))

    def _stances(self) -> list[tuple[int, int]]:
        """Return the frames from 15 to 75 % of each stance, in which the ankle hardly rises."""
        return [
            (round(a + 0.15 * self.share * (b - a)), round(a + 0.75 * self.share * (b - a)))
            for a, b in self.cycles
        ]

    def _mean(self, values: Array) -> Array:
        """Return the mean over the cycles at 100 phases, without a jump from end to beginning."""
        phases = np.arange(101) / 100
        frames = np.arange(len(values))
        cycles = [np.interp(a + phases * (b - a), frames, values) for a, b in self.cycles]
        mean = np.mean(cycles, axis=0)
        return np.asarray((mean - phases * (mean[-1] - mean[0]))[:-1])


def _strike(heel: Array, peak: int, width: int) -> int:
    """Return the frame of a heel strike near the frame `peak`, in which the heel is furthest ahead.

    Zeni et al. take the peak, where the heel moves forward as fast as the hips. The standing foot
    moves back from the hips at the walking speed, and at about half this speed when it strikes.
    """
    fast = _falling(heel[peak : peak + width])
    return peak + int(fast[0]) if len(fast) else peak


def _toe_off(ball: Array, strike: int, following: int) -> int:
    """Return the frame in which the ball of the foot leaves the ground, as in `_strike`."""
    last = strike + int(np.argmin(ball[strike:following]))
    fast = _falling(ball[strike : last + 1])
    return strike + int(fast[-1]) + 1 if len(fast) else last


def _falling(values: Array) -> NDArray[np.intp]:
    """Return the frames from which values fall at more than half of their median rate."""
    rates = np.diff(values)
    return np.flatnonzero(rates < np.median(rates) / 2) if len(rates) else np.arange(0)


def _peaks(values: Array, width: int) -> list[int]:
    """Return the peaks: large values that are the largest within `width`, not at the ends."""
    # a kick or a jump may cause the largest value of all
    large = values.mean() + 0.5 * (np.percentile(values, 90) - values.mean())
    edge = max(width // 4, 1)
    return [
        i
        for i in range(edge, len(values) - edge)
        # the first of equal values, as in a pause
        if values[max(i - width, 0) : i].max() < values[i] >= large
        and values[i] == values[i : i + width + 1].max()
    ]
