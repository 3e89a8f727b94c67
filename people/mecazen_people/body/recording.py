"""A recorded walk becomes a gait: curves over the mean cycle, stance, stride and speed."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mecazen.config.people import HEIGHT_M, HEIGHTS_M, Body
from mecazen.errors import ConfigError
from mecazen.portable import arctan2
from numpy.typing import NDArray

from mecazen_people.body.files import Array, MotionFile, read
from mecazen_people.body.gait import Fourier, Gait, LegCurves
from mecazen_people.body.posture import PELVIS_TILT, Segments


class Markers(NamedTuple):
    """Names of the points of a leg in files of one system, "" for none; {} is the side."""

    hip: str
    knee: str
    ankle: str
    toe: str
    pelvis: str
    """On the front of the pelvis, for files without hip joints."""
    source: str


_PLUG_IN = "Vicon Nexus, Plug-in Gait Reference Guide"
_CMU = "CMU Graphics Lab Motion Capture Database"
_QUALISYS = "marker set guides of Qualisys Track Manager"
_CAST = "Cappozzo et al., Clin. Biomech. 10, 1995; Leardini et al., Gait & Posture 26, 2007"
MARKERS = {
    "`mecazen gait --export`": Markers("{}Hip", "{}Knee", "{}Ankle", "{}Ball", "", "mocap.md"),
    "Pose2Sim (HALPE_26), OpenCap's keypoints": Markers(
        "{}Hip", "{}Knee", "{}Ankle", "{}BigToe", "", "Pose2Sim.skeletons"
    ),
    "Plug-in Gait, bones": Markers("{}FEP", "{}FEO", "{}TIO", "{}TOO", "", _PLUG_IN),
    "OpenCap's markers, OpenSim": Markers(
        "{}HJC", "{}Knee", "{}Ankle", "{}Toe", "{}ASIS", "opencap-core, OpenSim's gait2392"
    ),
    "Plug-in Gait, joint centres": Markers("{}HJC", "{}KJC", "{}AJC", "{}TOE", "{}ASI", _PLUG_IN),
    "Plug-in Gait, markers": Markers("", "{}KNE", "{}ANK", "{}TOE", "{}ASI", _PLUG_IN),
    "CMU": Markers("", "{}KNE", "{}ANK", "{}TOE", "{}FWT", _CMU),
    "Qualisys Animation": Markers(
        "", "{}KneeOut", "{}AnkleOut", "{}ToeTip", "Waist{}Front", _QUALISYS
    ),
    "Qualisys Sports": Markers(
        "", "{}KneeOut", "{}AnkleOut", "{}Forefoot2", "Waist{}Front", _QUALISYS
    ),
    "CAST, IOR (Qualisys, OptiTrack)": Markers("", "{}FLE", "{}FAL", "{}FM2", "{}IAS", _CAST),
    "CAST, IOR, without a marker on the second toe": Markers(
        "", "{}FLE", "{}FAL", "{}FM1", "{}IAS", _CAST
    ),
}
"""The systems that can be read; of several names in a file the first row applies."""
_SIDES = ("Left", "Right")
_UPRIGHT = 0.8  # least part of the way from ankles to hips along the vertical axis
STRIDE_S = 1.2
"""About the time of a stride, in which the pelvis has the mean heading of the walk."""
MIN_TRACK_S = 1.0
"""Shortest track that can be a path."""
_SITTING = 0.75  # of the usual height of the hips above the ankles; below, the person sits
_STRAIGHTEST = np.radians(3.0)  # least flexion of the knee
_IRREGULAR = 0.3  # largest deviation of a cycle, as a share of the usual length
_FLAT = (0.3, 0.5)  # part of the stance in which the foot is taken as flat


def height_of(body: Body) -> float:
    """Return the height of a person [m]: as configured, else that of their motion file."""
    if body.height_m is not None or body.motion_file is None:
        return body.height_m or HEIGHT_M
    motion = read(body.motion_file)
    if any(values.ndim == 1 for values in motion.values.values()):
        return HEIGHT_M  # angles only
    with _errors_of(body.motion_file):
        return _unit_and_height(motion)[1]


def read_pelvis(file: Path) -> Array:
    """Read the track of the pelvis: time [s], x and y [m], heading [rad] of each frame (n, 4).

    Frames in which the person sits or is hidden are left out. The pelvis's sway is removed: to the
    side, places are averaged over a stride.
    """
    motion = read(file)
    with _errors_of(file):
        unit, _ = _unit_and_height(motion)
        up, ahead = _frame(motion)
        places = unit * (_pelvis(motion, 0) + _pelvis(motion, 1)) / 2
        seen = np.flatnonzero(np.isfinite(ahead + places).all(axis=1))
        if (duration := len(seen) / motion.rate_hz) < MIN_TRACK_S:
            raise ConfigError(f"must show a person for {MIN_TRACK_S:g} s, shows {duration:.2g} s")
    across = [(up + 1) % 3, (up + 2) % 3]
    (cos, sin), (x, y) = ahead[seen][:, across].T, places[seen][:, across].T
    mean = _mean_over(places[seen], round(STRIDE_S * motion.rate_hz))[:, across].T
    sway = cos * (y - mean[1]) - sin * (x - mean[0])
    track = (seen / motion.rate_hz, x + sin * sway, y - cos * sway, np.unwrap(arctan2(sin, cos)))
    return np.column_stack(track)


@contextmanager
def _errors_of(file: Path) -> Iterator[None]:
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None


def read_recording(file: Path, segments: Segments) -> Gait:
    """Read a recorded walk on level ground, straight on or on a treadmill.

    The result has the sagittal angles, the stance shares, the phase between the legs, and the
    stride. Heel strike is where the heel is furthest ahead of the hip, toe-off shortly before the
    ball of the foot is furthest behind (after J. A. Zeni et al., Gait & Posture 27, 2008). The
    speed is that of the standing foot relative to the hips, computed with `segments`.
    """
    motion = read(file)
    with _errors_of(file):
        legs = _whole(np.array([_angles(motion, side) for side in (0, 1)]))
        cycles = [_Cycles(motion.rate_hz, leg, segments) for leg in legs]
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


def _whole(angles: Array) -> Array:
    """Return the longest part without a gap of angles over frames (2, 3, n)."""
    gaps = np.flatnonzero(~np.isfinite(angles).all(axis=(0, 1)))
    edges = np.concatenate([[-1], gaps, [angles.shape[2]]])
    longest = int(np.argmax(np.diff(edges)))
    if edges[longest + 1] - edges[longest] < 3:
        raise ConfigError("must have all markers in some frames that follow each other")
    return angles[:, :, edges[longest] + 1 : edges[longest + 1]]


def _frame(motion: MotionFile) -> tuple[int, Array]:
    """Return the axis that points up, and the direction straight ahead over the frames (n, 3).

    Up is from the ankles to the hips, in the mean; ahead is square to the hips, in the mean of a
    stride, and NaN while the person sits or is hidden.
    """
    left, right = (_pelvis(motion, side) for side in (0, 1))
    above = (left - _point(motion, "ankle", 0)) + (right - _point(motion, "ankle", 1))
    mean = np.nan_to_num(above).mean(axis=0)
    up = int(np.argmax(np.abs(mean)))
    if not mean[up] > _UPRIGHT * float(np.sqrt((mean * mean).sum())):
        shown = ", ".join(f"{value / 2:.3g}" for value in mean)
        raise ConfigError(
            f"must have x, y or z point up; its hips are [{shown}] above its ankles in the mean"
        )
    upright = above[:, up] > _SITTING * np.nanpercentile(above[:, up], 90)
    across = left - right
    across[:, up] = 0.0
    across = _mean_over(across, round(STRIDE_S * motion.rate_hz))
    ahead = np.cross(across, np.eye(3)[up])
    length = np.sqrt((ahead * ahead).sum(axis=1))
    if not (length > 0.0).any():
        raise ConfigError("must have its hips side by side")
    return up, ahead / np.where(upright & (length > 0.0), length, np.nan)[:, None]


def _unit_and_height(motion: MotionFile) -> tuple[float, float]:
    """Return the unit of a file [m] and the height of its person [m].

    Both follow from the shanks, which have markers at both ends in all systems.
    """
    shank = 0.0
    for side in (0, 1):
        bone = _point(motion, "knee", side) - _point(motion, "ankle", side)
        shank += float(np.nanmedian(np.sqrt((bone * bone).sum(axis=1)))) / 2
    share = Segments.from_height(1.0).shank
    for unit in (1.0, 0.01, 0.001):
        if HEIGHTS_M[0] <= shank * unit / share <= HEIGHTS_M[1]:
            return unit, shank * unit / share
    low, high = (f"{share * end:.2f}" for end in HEIGHTS_M)
    raise ConfigError(f"must have shanks of {low} to {high} m in m, cm or mm, has {shank:.3g}")


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
    up, ahead = _frame(motion)
    knee, ankle, toe = (_point(motion, name, side) for name in ("knee", "ankle", "toe"))
    hip = _hip(motion, side, ahead, up)
    if np.nansum((toe - ankle) * ahead) < 0.0:
        raise ConfigError(
            "has its toes behind its ankles: left and right are swapped, or an axis is mirrored"
        )
    thigh, shank, foot = (
        np.stack([(p * ahead).sum(axis=1), p[:, up]])
        for p in (knee - hip, ankle - knee, toe - ankle)
    )
    thigh_angle, shank_angle = (arctan2(x, -z) for x, z in (thigh, shank))
    pitch = arctan2(foot[1], foot[0])
    return np.array([thigh_angle + PELVIS_TILT, thigh_angle - shank_angle, pitch - shank_angle])


def _hip(motion: MotionFile, side: int, ahead: Array, up: int) -> Array:
    """Return a hip joint's centre (n, 3); if it is not recorded, from the markers on the pelvis.

    The centre is 14 % of the markers' distance inwards, 19 % behind and 30 % below (A. L. Bell et
    al., J. Biomech. 23, 1990).
    """
    if _marker(motion, "hip", side) is not None:
        return _point(motion, "hip", side)
    near, far = _point(motion, "pelvis", side), _point(motion, "pelvis", 1 - side)
    width = np.sqrt(((near - far) ** 2).sum(axis=1, keepdims=True))
    down = np.eye(3)[up]
    centre: Array = near + 0.14 * (far - near) - width * (0.19 * ahead + 0.30 * down)
    return centre


def _pelvis(motion: MotionFile, side: int) -> Array:
    marker = _marker(motion, "pelvis", side)
    return _point(motion, "hip", side) if marker is None else marker


def _mean_over(values: Array, width: int) -> Array:
    """Return the moving average of values (n, 3), over fewer values at the ends."""
    sums = np.cumsum(np.vstack([np.zeros(3), np.nan_to_num(values)]), axis=0)
    n = np.arange(len(values))
    first, last = np.maximum(n - width // 2, 0), np.minimum(n + width // 2 + 1, len(values))
    mean: Array = (sums[last] - sums[first]) / (last - first)[:, None]
    return mean


def _marker(motion: MotionFile, point: str, side: int) -> Array | None:
    """Return a point of a leg (n, 3) by any of its names, also with a prefix; None without it."""
    text = _SIDES[side]
    for name in _names(point):
        marker = name.format(rf"(?:{text}|{text[0]})[._ ]?")
        pattern = re.compile(rf"(|.*[:_ ]){marker}(?:_study)?", re.IGNORECASE)
        matches = {key: match[1] for key in motion.values if (match := pattern.fullmatch(key))}
        if len(set(matches.values())) > 1:
            raise ConfigError(f"has the points {', '.join(matches)}; export a single person")
        for key in matches:
            if motion.values[key].ndim == 2 and np.isfinite(motion.values[key]).any():
                return motion.values[key]
    return None


def _names(point: str) -> list[str]:
    return list(dict.fromkeys(name for row in MARKERS.values() if (name := getattr(row, point))))


def _point(motion: MotionFile, point: str, side: int) -> Array:
    if (places := _marker(motion, point, side)) is None:
        known = ", ".join(name.format(_SIDES[side][0]) for name in _names(point))
        shown = ", ".join([*motion.values][:8]) + ", …" * (len(motion.values) > 8)
        raise ConfigError(
            f"has no point for the {_SIDES[side].lower()} {point}; known: {known}; "
            f"it has {shown or 'none'}"
        )
    return places


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
            shown = f"{len(heel) / rate_hz:.2g}"
            raise ConfigError(
                f"must have a whole gait cycle of each leg: two strikes of each heel in a part "
                f"without a hidden marker; the longest lasts {shown} s"
            )
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
        # from 15 to 75 % of each stance, in which the ankle hardly rises
        stances = [
            [round(a + part * self.share * (b - a)) for part in (0.15, 0.75)]
            for a, b in self.cycles
        ]
        slopes = [(ahead[b] - ahead[a]) / (b - a) for a, b in stances]
        self.speed = max(-float(np.mean(slopes)) * rate_hz, 0.05)
        self.curves: LegCurves = (Fourier(mean[0]), Fourier(mean[1]), Fourier(mean[2]))

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
