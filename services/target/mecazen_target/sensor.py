"""What the robot's sensor sees of the person."""

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
    """What the sensor saw at one time."""

    capture_tick: int
    """Tick at which it was seen; 0 for the frames that come before anything was."""
    pose: Pose2D | None
    """The person in `SensorConfig.frame`, base_link as it was then; None if not seen."""


class Sensor:
    """A sensor that measures the person's pose from where the robot truly is.

    Noise is added from an array that is generated in advance from `seed`, one row for each
    frame, seen or not: what is hidden in one setting does not change what is seen in another.

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
        """Of a seen pose, as ROS has it; the entries of what is not measured are 0."""

    def observe(self, tick: int, robot: Pose2D, person: Pose2D) -> Frame | None:
        """Take the true poses in the world at `tick`; return the frame that arrives then.

        Called at every tick, counted from 0. None at ticks that bring no frame.
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
        """Return whether the person, in base_link, is in view at the tick of the capture."""
        hidden = any(begin <= tick < end for begin, end in self._occlusions)
        near = math.hypot(person.x, person.y) <= self._config.max_range_m
        bearing = abs(math.atan2(person.y, person.x))
        return near and not hidden and bearing <= math.radians(self._config.fov_deg) / 2
