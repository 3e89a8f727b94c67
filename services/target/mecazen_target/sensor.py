"""The robot's sensor that observes the person."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from mecazen.config import SensorConfig, whole_ticks
from mecazen.covariance import diagonal_covariance
from mecazen.geometry import Pose2D, wrap

NOISE_FRAMES = 2**16
"""Frames after which the noise repeats: 44 minutes at 25 Hz."""


class Frame(NamedTuple):
    """One frame of the sensor."""

    capture_tick: int
    """Tick of the capture; 0 for frames that arrive before the latency has passed."""
    pose: Pose2D | None
    """The person in `SensorConfig.frame` at the capture; None if not seen."""


class Sensor:
    """A sensor on the true robot that measures the person's pose.

    The noise comes from an array generated in advance from `seed`, with a row for each frame,
    seen or not. So occlusions and dropouts do not change the noise of the other frames.

    Raises:
        ConfigError: The `rate_hz` does not divide the tick rate, or `latency_s` is not a whole
            number of ticks.
    """

    def __init__(self, config: SensorConfig, seed: int, tick_s: float) -> None:
        self._config = config
        self._ticks_per_frame = config.ticks_per_frame(tick_s)
        self._latency = whole_ticks("sensor.latency_s", config.latency_s, tick_s)
        self._occlusions = [
            (round(begin / tick_s), round(end / tick_s)) for begin, end in config.occlusions_s
        ]
        self._past: deque[tuple[int, Pose2D, Pose2D]] = deque(maxlen=self._latency + 1)
        random = np.random.Generator(np.random.PCG64(seed))
        position, yaw = config.position_std_m, math.radians(config.yaw_std_deg)
        self._noise = random.standard_normal((NOISE_FRAMES, 3)) * (position, position, yaw)
        self._dropped = random.random(NOISE_FRAMES) < config.dropout_probability
        self.covariance = diagonal_covariance((position**2, position**2, 0.0, 0.0, 0.0, yaw**2))
        """ROS's 6x6 covariance of an observed pose; entries that are not measured are 0."""

    def observe(self, tick: int, robot: Pose2D, person: Pose2D) -> Frame | None:
        """Return the frame that arrives at `tick`, given the true poses in the world then.

        It is called at every tick, counted from 0; None at ticks without a frame.
        """
        self._past.append((tick, robot, person))
        if tick % self._ticks_per_frame:
            return None
        capture = max(tick - self._latency, 0)
        captured, robot, person = self._past[0]
        row = tick // self._ticks_per_frame % NOISE_FRAMES
        relative = robot.between(person)
        seen = captured == tick - self._latency and self._sees(capture, relative)
        if not seen or self._dropped[row]:
            return Frame(capture, None)
        pose = person if self._config.frame == "world" else relative
        x, y, yaw = self._noise[row].tolist()
        return Frame(capture, Pose2D(pose.x + x, pose.y + y, wrap(pose.yaw + yaw)))

    def _sees(self, tick: int, person: Pose2D) -> bool:
        """Return whether the person, in base_link, is visible at the tick of the capture."""
        hidden = any(begin <= tick < end for begin, end in self._occlusions)
        within_range = math.hypot(person.x, person.y) <= self._config.max_range_m
        bearing = abs(math.atan2(person.y, person.x))
        return within_range and not hidden and bearing <= math.radians(self._config.fov_deg) / 2
