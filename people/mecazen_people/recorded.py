"""A recorded track: timed positions become a smooth motion with a heading."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from io import StringIO
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from mecazen.errors import ConfigError
from mecazen.files import read_text
from mecazen.geometry import Pose2D, Twist2D, rotate, wrap

from mecazen_people.motion import Motion
from mecazen_people.spline import Spline, limited_slopes, simpson

MAX_DURATION_S = 4 * 3600.0
"""Longest track that is read; a longer one is most likely in the wrong unit."""
MAX_ROWS = 400_000
"""Maximum number of rows; 4 h at 25 Hz have 360,000."""
MIN_STEP_S = 0.001
"""Shortest time between two rows."""
STANDING_M_S, WALKING_M_S = 0.1, 0.2
"""Below the first speed the heading is held, above the second it follows the motion, between them
partly."""
MAX_YAW_RATE = 3.0
"""Maximum yaw rate of a walking person [rad/s]."""

_STEP_S = 0.04  # between knots of heading and distance
_CORRECTION = 5.0  # gain on the lag of the heading [1/s]


class Sample(NamedTuple):
    """A row of a recorded track."""

    t: float
    x: float
    y: float


class RecordedMotion:
    """The motion of a recorded track, from time 0 on, in the frame of the recording.

    Cubics in time interpolate the samples: the person stands still between equal samples and
    walks evenly over a gap. The position is the moving average of that curve, since samples of
    tracked people jump by decimetres. The first and the last sample keep their place.

    The heading is the direction of motion. It is held while the person stands, and its rate is
    limited: a person who stops and leaves in another direction turns while setting off, and the
    twist has a lateral component until then. The heading of a track without motion is 0.

    Args:
        samples: The track.
        smoothing: Window of the moving average [s].
    """

    def __init__(self, samples: Sequence[Sample], smoothing: float) -> None:
        self.duration = samples[-1].t - samples[0].t
        self._half = min(smoothing, self.duration) / 2
        # extended by point reflection about both ends, so that the average keeps the ends
        first, last = samples[0], samples[-1]
        before = [_opposite(sample, first) for sample in reversed(samples[1:])]
        after = [_opposite(sample, last) for sample in reversed(samples[:-1])]
        through = [*before, *samples, *after]
        times = [sample.t - first.t for sample in through]
        x, y = [sample.x for sample in through], [sample.y for sample in through]
        dx, dy = limited_slopes(times, x, y)
        self._x, self._y = Spline(times, x, dx), Spline(times, y, dy)
        pieces = math.ceil(self.duration / _STEP_S)
        knots = [self.duration * i / pieces for i in range(pieces + 1)]
        velocities = [self._velocity(t) for t in knots]
        headings = _headings(velocities, self.duration / pieces)
        self._yaw = Spline(knots, headings, *limited_slopes(knots, headings))
        speeds = [math.hypot(*velocity) for velocity in velocities]
        self._distance = Spline(knots, simpson(knots, speeds, self._speed), speeds)

    def at(self, t: float) -> Motion:
        """Return the motion at the time `t` [s]; at rest before 0 and after the end."""
        inside = min(max(t, 0.0), self.duration)
        yaw, yaw_rate, _ = self._yaw.at(inside)
        distance, _, _ = self._distance.at(inside)
        x, y = (_mean(curve, inside, self._half) for curve in (self._x, self._y))
        pose = Pose2D(x, y, wrap(yaw))
        if t != inside:
            return Motion(pose, Twist2D(), distance)
        return Motion(pose, Twist2D(*rotate(*self._velocity(t), -yaw), yaw_rate), distance)

    def _velocity(self, t: float) -> tuple[float, float]:
        """Return the derivative of the averaged position: the difference over the window."""
        x, y = (
            (curve.at(t + self._half)[0] - curve.at(t - self._half)[0]) / (2 * self._half)
            for curve in (self._x, self._y)
        )
        return x, y

    def _speed(self, t: float) -> float:
        return math.hypot(*self._velocity(t))


def _opposite(sample: Sample, centre: Sample) -> Sample:
    return Sample(*(2 * c - s for s, c in zip(sample, centre, strict=True)))


def _mean(curve: Spline, t: float, half: float) -> float:
    return (curve.integral(t + half) - curve.integral(t - half)) / (2 * half)


def _headings(velocities: Sequence[tuple[float, float]], step: float) -> list[float]:
    """Return the headings [rad], not wrapped, of `velocities` that are `step` [s] apart.

    The heading follows the direction of motion, with a proportional gain on its lag, weighted by
    `_walking` and limited to `MAX_YAW_RATE`.
    """
    directions = [math.atan2(y, x) for x, y in velocities]
    shares = [_walking(math.hypot(x, y)) for x, y in velocities]
    moving = (d for d, share in zip(directions, shares, strict=True) if share > 0.0)
    headings = [next(moving, 0.0)]
    limit = MAX_YAW_RATE * step
    for (d0, d1), (share0, share1) in zip(pairwise(directions), pairwise(shares), strict=True):
        lag = wrap(d0 - headings[-1])
        turn = wrap(d1 - d0) + _CORRECTION * step * lag
        headings.append(headings[-1] + min(share0, share1) * min(max(turn, -limit), limit))
    return headings


def _walking(speed: float) -> float:
    """Return 0 when standing, 1 when walking, and a smooth step in between."""
    part = min(max((speed - STANDING_M_S) / (WALKING_M_S - STANDING_M_S), 0.0), 1.0)
    return part * part * (3.0 - 2.0 * part)


def read_track(file: Path) -> list[Sample]:
    """Read a CSV with the columns `t_s`, `x_m`, `y_m`, in any order and among others."""
    lines = StringIO(read_text(file), newline="")
    try:
        samples = list(_rows(csv.DictReader(lines)))
    except (ConfigError, csv.Error) as error:
        raise ConfigError(f"{file}: {error}") from error
    if len(samples) < 2:
        raise ConfigError(f"{file}: must have at least 2 rows below its header, has {len(samples)}")
    duration = samples[-1].t - samples[0].t
    if duration > MAX_DURATION_S:
        raise ConfigError(
            f"{file}: t_s must span at most {MAX_DURATION_S:g} s, spans {duration:g} s"
        )
    return samples


def _rows(reader: csv.DictReader[str]) -> Iterator[Sample]:
    header = reader.fieldnames or []
    missing = [name for name in ("t_s", "x_m", "y_m") if name not in header]
    if missing:
        raise ConfigError(f"line 1: must name the columns t_s,x_m,y_m; {','.join(missing)} missing")
    last = -math.inf
    for number, row in enumerate(reader, start=1):
        line = f"line {reader.line_num}"
        sample = Sample(*(_number(line, name, row[name]) for name in ("t_s", "x_m", "y_m")))
        if sample.t - last < MIN_STEP_S:
            raise ConfigError(
                f"{line}: t_s must grow by at least {MIN_STEP_S} s, {sample.t:g} follows {last:g}"
            )
        if number > MAX_ROWS:
            raise ConfigError(f"{line}: must have at most {MAX_ROWS} rows")
        last = sample.t
        yield sample


def _number(line: str, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not abs(value) <= 1e9:
        raise ConfigError(f"{line}: {name} must be a number from -1e9 to 1e9, is {text or ''!r}")
    return value
