"""Faults of real person trackers: `SensorFaults` applied to frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt
from mecazen.config import SensorConfig
from mecazen.geometry import Pose2D, wrap
from mecazen.portable import Floats
from numpy.random import PCG64, Generator

Flags = npt.NDArray[np.bool_]

FAULTS_STREAM = 1
"""Stream number of the faults, used with the seed: separate draws leave the noise unchanged."""


def in_ticks(intervals_s: Sequence[tuple[float, float]], tick_s: float) -> list[tuple[int, int]]:
    """Return intervals [s] in ticks."""
    return [(round(begin / tick_s), round(end / tick_s)) for begin, end in intervals_s]


class Faults:
    """The faults of a sensor; random faults repeat after `frames` frames."""

    def __init__(self, config: SensorConfig, seed: int, frames: int, tick_s: float) -> None:
        self._sensor = config
        self._config = faults = config.faults
        self._seed, self._frames = seed, frames
        self._stand_ins = in_ticks(faults.stand_ins_s, tick_s)
        self._distorts = faults.outlier_probability > 0.0 or faults.flip_probability > 0.0

    @cached_property
    def _drawn(self) -> tuple[Floats, Flags, Floats, Flags]:
        """The random numbers of the faults; they take megabytes, so they are drawn on demand.

        For each frame they are the offset of an outlier (n, 2) [m], whether the heading is flipped
        (n), the noise of the second person (n, 3), and whether that person is named first (n).
        """
        faults, frames = self._config, self._frames
        random = Generator(PCG64([self._seed, FAULTS_STREAM]))
        outlying = random.random(frames) < faults.outlier_probability
        direction = 2.0 * math.pi * random.random(frames)
        way = faults.outlier_m * np.stack((np.cos(direction), np.sin(direction)), axis=-1)
        flipped = random.random(frames) < faults.flip_probability
        position, yaw = self._sensor.position_std_m, math.radians(self._sensor.yaw_std_deg)
        return (
            np.where(outlying[:, None], way, 0.0),
            flipped,
            random.standard_normal((frames, 3)) * (position, position, yaw),
            random.random(frames) < 0.5,
        )

    def correlated(self, noise: Floats) -> Floats:
        """Return white noise (n, 3) correlated over time, of the same variance.

        The result is an Ornstein-Uhlenbeck process, sampled at the frames.
        """
        if not self._config.noise_correlation_s:
            return noise
        keep = math.exp(-1.0 / self._sensor.rate_hz / self._config.noise_correlation_s)
        fresh = math.sqrt(1.0 - keep * keep)
        coloured = noise.copy()
        for row in range(1, len(noise)):
            coloured[row] = keep * coloured[row - 1] + fresh * noise[row]
        return coloured

    def shown(self, tick: int, person: Pose2D) -> tuple[Pose2D | None, Pose2D | None]:
        """Return the true poses of the first and the second person that a frame shows."""
        if not self._config.other_m:
            return person, None
        other = person._replace(y=person.y + self._config.other_m)
        if any(begin <= tick < end for begin, end in self._stand_ins):
            return other, None
        return person, other if self._config.other_seen else None

    def distorted(self, row: int, pose: Pose2D) -> Pose2D:
        """Return the first person's pose with the outliers and flips of a frame."""
        if not self._distorts:
            return pose
        offsets, flipped, _, _ = self._drawn
        x, y = offsets[row].tolist()
        yaw = wrap(pose.yaw + math.pi) if flipped[row] else pose.yaw
        return Pose2D(pose.x + x, pose.y + y, yaw)

    def noisy(self, row: int, other: Pose2D) -> Pose2D:
        """Return the second person's pose with the noise of a frame."""
        x, y, yaw = self._drawn[2][row].tolist()
        return Pose2D(other.x + x, other.y + y, wrap(other.yaw + yaw))

    def names_other_first(self, row: int) -> bool:
        """Return whether a frame names the second person before the first."""
        return bool(self._drawn[3][row])
