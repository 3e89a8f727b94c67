"""The robot's sensor that observes the person, with the faults of real person trackers."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mecazen.config import SensorConfig
from mecazen.geometry import Pose2D, wrap
from mecazen.messages import Unseen, diagonal_covariance
from mecazen.portable import Floats
from mecazen.ticks import ticks_per_sample, whole_ticks
from numpy.random import PCG64, Generator

Flags = npt.NDArray[np.bool_]

NOISE_FRAMES = 2**16
"""Frames after which the noise repeats: 44 minutes at 25 Hz."""
FAULTS_STREAM = 1
"""Stream number of the faults, used with the seed: separate draws leave the noise unchanged."""


class SensorFrame(NamedTuple):
    """One frame of the sensor."""

    capture_tick: int
    """Tick of the capture; 0 for frames that arrive before the latency has passed."""
    pose: Pose2D | None
    """The person in `SensorConfig.frame` at the capture; None if not seen."""
    second: Pose2D | None = None
    """A second person, likewise."""
    second_first: bool = False
    """Whether the second person is listed first: a sensor has no order."""
    reason: str = ""
    """Why the first person is not seen: a word of `Unseen`; empty if a fault is the cause."""


def latency_ticks(config: SensorConfig, tick_s: float) -> int:
    """Return the number of ticks after which a frame arrives."""
    return whole_ticks("sensor.latency_s", config.latency_s, tick_s) + whole_ticks(
        "sensor.faults.unsaid_latency_s", config.faults.unsaid_latency_s, tick_s
    )


class _DrawnFaults(NamedTuple):
    """The random faults of n frames."""

    outliers: Floats
    """Offsets of outliers (n, 2) [m]."""
    flipped: Flags
    """Whether the heading is flipped (n)."""
    second: Floats
    """Noise of the second person (n, 3)."""
    second_first: Flags
    """Whether the second person is named first (n)."""


class Sensor:
    """A sensor on the true robot that measures the person's pose.

    The noise comes from an array generated in advance from `seed`, with a row for each frame,
    seen or not. So occlusions, dropouts and faults do not change the noise of other frames.
    """

    def __init__(self, config: SensorConfig, seed: int, tick_s: float) -> None:
        self._config, self._seed = config, seed
        self._ticks_per_frame = ticks_per_sample("sensor.rate_hz", config.rate_hz, tick_s)
        self._latency = latency_ticks(config, tick_s)
        self._occlusions = _in_ticks(config.occlusions_s, tick_s)
        self._stand_ins = _in_ticks(config.faults.stand_ins_s, tick_s)
        self._past: deque[tuple[int, Pose2D, Pose2D]] = deque(maxlen=self._latency + 1)
        random = Generator(PCG64(seed))
        position, yaw = config.position_std_m, math.radians(config.yaw_std_deg)
        self._std = position, position, yaw
        self._noise = self._correlated(random.standard_normal((NOISE_FRAMES, 3)) * self._std)
        self._dropped = random.random(NOISE_FRAMES) < config.dropout_probability
        position, yaw = (std * config.faults.reported_noise_ratio for std in (position, yaw))
        self.covariance = diagonal_covariance((position**2, position**2, 0.0, 0.0, 0.0, yaw**2))
        """ROS's 6x6 covariance of an observed pose; entries that are not measured are 0."""

    def observe(self, tick: int, robot: Pose2D, person: Pose2D) -> SensorFrame | None:
        """Return the frame that arrives at `tick`, given the true poses in the world at that tick.

        Call this at every tick, counted from 0; the result is None at ticks without a frame.
        """
        self._past.append((tick, robot, person))
        if tick % self._ticks_per_frame:
            return None
        capture = max(tick - self._latency, 0)
        captured, robot, person = self._past[0]
        row = tick // self._ticks_per_frame % NOISE_FRAMES
        if captured != tick - self._latency or self._dropped[row]:
            return SensorFrame(capture, None, reason=Unseen.BLIND if self._dropped[row] else "")
        first, second = (self._seen(capture, robot, whom) for whom in self._shown(capture, person))
        if first is not None:
            first = self._distorted(row, _moved(first, self._noise[row]))
        second_first = False
        if second is not None:
            second = _moved(second, self._drawn.second[row])
            second_first = bool(self._drawn.second_first[row])
        reason = "" if first is not None else self._reason(capture, robot.between(person))
        return SensorFrame(capture, first, second, second_first, reason)

    def _shown(self, tick: int, person: Pose2D) -> tuple[Pose2D | None, Pose2D | None]:
        """Return the true poses of the first and the second person that a frame shows."""
        faults = self._config.faults
        if not faults.other_m:
            return person, None
        second = person._replace(y=person.y + faults.other_m)
        if any(begin <= tick < end for begin, end in self._stand_ins):
            return second, None
        return person, second if faults.other_seen else None

    def _seen(self, tick: int, robot: Pose2D, person: Pose2D | None) -> Pose2D | None:
        """Return a person in `SensorConfig.frame`; None if absent or not seen at that tick."""
        if person is None:
            return None
        relative = robot.between(person)
        if self._reason(tick, relative):
            return None
        return person if self._config.frame == "world" else relative

    def _reason(self, tick: int, person: Pose2D) -> str:
        """Return why the person, in base_link, is not seen at the tick of the capture, or ""."""
        if any(begin <= tick < end for begin, end in self._occlusions):
            return Unseen.BLIND
        if math.hypot(person.x, person.y) > self._config.max_range_m:
            return Unseen.TOO_FAR
        bearing = math.atan2(person.y, person.x)
        if abs(bearing) <= math.radians(self._config.fov_deg) / 2:
            return ""
        return Unseen.LEFT if bearing > 0.0 else Unseen.RIGHT

    def _distorted(self, row: int, pose: Pose2D) -> Pose2D:
        """Return the first person's pose with the outliers and flips of a frame."""
        faults = self._config.faults
        if not (faults.outlier_probability or faults.flip_probability):
            return pose
        x, y = self._drawn.outliers[row].tolist()
        yaw = wrap(pose.yaw + math.pi) if self._drawn.flipped[row] else pose.yaw
        return Pose2D(pose.x + x, pose.y + y, yaw)

    @cached_property
    def _drawn(self) -> _DrawnFaults:
        """The random faults; they take megabytes, so they are drawn on demand."""
        faults = self._config.faults
        random = Generator(PCG64([self._seed, FAULTS_STREAM]))
        outlying = random.random(NOISE_FRAMES) < faults.outlier_probability
        direction = 2.0 * math.pi * random.random(NOISE_FRAMES)
        offsets = faults.outlier_m * np.stack((np.cos(direction), np.sin(direction)), axis=-1)
        flipped = random.random(NOISE_FRAMES) < faults.flip_probability
        return _DrawnFaults(
            np.where(outlying[:, None], offsets, 0.0),
            flipped,
            random.standard_normal((NOISE_FRAMES, 3)) * self._std,
            random.random(NOISE_FRAMES) < 0.5,
        )

    def _correlated(self, noise: Floats) -> Floats:
        """Return white noise (n, 3) correlated over time, of the same variance.

        The result is an Ornstein-Uhlenbeck process, sampled at the frames.
        """
        if not self._config.faults.noise_correlation_s:
            return noise
        keep = math.exp(-1.0 / self._config.rate_hz / self._config.faults.noise_correlation_s)
        fresh = math.sqrt(1.0 - keep * keep)
        coloured = noise.copy()
        for row in range(1, len(noise)):
            coloured[row] = keep * coloured[row - 1] + fresh * noise[row]
        return coloured


def _moved(pose: Pose2D, noise: Floats) -> Pose2D:
    x, y, yaw = noise.tolist()
    return Pose2D(pose.x + x, pose.y + y, wrap(pose.yaw + yaw))


def _in_ticks(intervals_s: Sequence[tuple[float, float]], tick_s: float) -> list[tuple[int, int]]:
    """Return intervals [s] in ticks."""
    return [(round(begin / tick_s), round(end / tick_s)) for begin, end in intervals_s]
