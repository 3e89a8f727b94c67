"""What a real tracker of people does wrong: `SensorFaults` applied to frames."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from mecazen.config import SensorConfig
from mecazen.geometry import Pose2D, wrap
from numpy.random import PCG64, Generator

Floats = npt.NDArray[np.float64]

FAULTS_STREAM = 1
"""Beside the seed: the faults are drawn apart, so that they leave the noise as it is."""


def in_ticks(intervals_s: Sequence[tuple[float, float]], tick_s: float) -> list[tuple[int, int]]:
    """Return intervals [s] in ticks."""
    return [(round(begin / tick_s), round(end / tick_s)) for begin, end in intervals_s]


class Faults:
    """The faults of a sensor, drawn in advance from `seed`, with a row for each frame."""

    def __init__(self, config: SensorConfig, seed: int, frames: int, tick_s: float) -> None:
        faults = config.faults
        self._config = faults
        self._frame_s = 1.0 / config.rate_hz
        self._stand_ins = in_ticks(faults.stand_ins_s, tick_s)
        random = Generator(PCG64([seed, FAULTS_STREAM]))
        outlying = random.random(frames) < faults.outlier_probability
        direction = 2.0 * math.pi * random.random(frames)
        way = faults.outlier_m * np.stack((np.cos(direction), np.sin(direction)), axis=-1)
        self._offsets = np.where(outlying[:, None], way, 0.0)
        self._flipped = random.random(frames) < faults.flip_probability
        position, yaw = config.position_std_m, math.radians(config.yaw_std_deg)
        self.other_noise: Floats = random.standard_normal((frames, 3)) * (position, position, yaw)
        """Of the second person (frames, 3)."""
        self.other_first: npt.NDArray[np.bool_] = random.random(frames) < 0.5
        """Whether a frame names the second person before the first."""

    def correlated(self, noise: Floats) -> Floats:
        """Return white noise (n, 3) correlated over time, of the same variance.

        It is the Ornstein-Uhlenbeck process, sampled at the frames.
        """
        if not self._config.noise_correlation_s:
            return noise
        keep = math.exp(-self._frame_s / self._config.noise_correlation_s)
        fresh = math.sqrt(1.0 - keep * keep)
        coloured = noise.copy()
        for row in range(1, len(noise)):
            coloured[row] = keep * coloured[row - 1] + fresh * noise[row]
        return coloured

    def shown(self, tick: int, person: Pose2D) -> tuple[Pose2D | None, Pose2D | None]:
        """Return whom a frame shows as the first person and as the second, at their true poses."""
        if not self._config.other_m:
            return person, None
        other = person._replace(y=person.y + self._config.other_m)
        if any(begin <= tick < end for begin, end in self._stand_ins):
            return other, None
        return person, other if self._config.other_seen else None

    def distorted(self, row: int, pose: Pose2D) -> Pose2D:
        """Return the first person's pose with the outliers and flips of a frame."""
        x, y = self._offsets[row].tolist()
        yaw = wrap(pose.yaw + math.pi) if self._flipped[row] else pose.yaw
        return Pose2D(pose.x + x, pose.y + y, yaw)
