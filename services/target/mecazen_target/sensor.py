"""The robot's sensor that observes the person."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from mecazen.config import SensorConfig
from mecazen.geometry import Pose2D, wrap
from mecazen.messages import diagonal_covariance
from mecazen.ticks import whole_ticks
from numpy.random import PCG64, Generator

from mecazen_target.faults import Faults, in_ticks

NOISE_FRAMES = 2**16
"""Frames after which the noise repeats: 44 minutes at 25 Hz."""


class Frame(NamedTuple):
    """One frame of the sensor."""

    capture_tick: int
    """Tick of the capture; 0 for frames that arrive before the latency has passed."""
    pose: Pose2D | None
    """The person in `SensorConfig.frame` at the capture; None if not seen."""
    other: Pose2D | None = None
    """A second person, likewise."""
    other_first: bool = False
    """Whether the second person is listed first: a sensor has no order."""


def latency_ticks(config: SensorConfig, tick_s: float) -> int:
    """Return the number of ticks after which a frame arrives."""
    return whole_ticks("sensor.latency_s", config.latency_s, tick_s) + whole_ticks(
        "sensor.faults.unsaid_latency_s", config.faults.unsaid_latency_s, tick_s
    )


class Sensor:
    """A sensor on the true robot that measures the person's pose.

    The noise comes from an array generated in advance from `seed`, with a row for each frame,
    seen or not. So occlusions, dropouts and faults do not change the noise of other frames.
    """

    def __init__(self, config: SensorConfig, seed: int, tick_s: float) -> None:
        self._config = config
        self._ticks_per_frame = config.ticks_per_frame(tick_s)
        self._latency = latency_ticks(config, tick_s)
        self._occlusions = in_ticks(config.occlusions_s, tick_s)
        self._faults = Faults(config, seed, NOISE_FRAMES, tick_s)
        self._past: deque[tuple[int, Pose2D, Pose2D]] = deque(maxlen=self._latency + 1)
        random = Generator(PCG64(seed))
        position, yaw = config.position_std_m, math.radians(config.yaw_std_deg)
        noise = random.standard_normal((NOISE_FRAMES, 3))
        noise *= position, position, yaw
        self._noise = self._faults.correlated(noise)
        self._dropped = random.random(NOISE_FRAMES) < config.dropout_probability
        position, yaw = (std * config.faults.reported_noise_ratio for std in (position, yaw))
        self.covariance = diagonal_covariance((position**2, position**2, 0.0, 0.0, 0.0, yaw**2))
        """ROS's 6x6 covariance of an observed pose; entries that are not measured are 0."""

    def observe(self, tick: int, robot: Pose2D, person: Pose2D) -> Frame | None:
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
            return Frame(capture, None)
        first, other = (
            self._seen(capture, robot, whom) for whom in self._faults.shown(capture, person)
        )
        if first is not None:
            x, y, yaw = self._noise[row].tolist()
            noisy = Pose2D(first.x + x, first.y + y, wrap(first.yaw + yaw))
            first = self._faults.distorted(row, noisy)
        if other is not None:
            other = self._faults.noisy(row, other)
        other_first = other is not None and self._faults.names_other_first(row)
        return Frame(capture, first, other, other_first)

    def _seen(self, tick: int, robot: Pose2D, person: Pose2D | None) -> Pose2D | None:
        """Return a person in `SensorConfig.frame`; None if absent or not seen at that tick."""
        if person is None:
            return None
        relative = robot.between(person)
        if not self._sees(tick, relative):
            return None
        return person if self._config.frame == "world" else relative

    def _sees(self, tick: int, person: Pose2D) -> bool:
        """Return whether the person, in base_link, is visible at the tick of the capture."""
        hidden = any(begin <= tick < end for begin, end in self._occlusions)
        within_range = math.hypot(person.x, person.y) <= self._config.max_range_m
        bearing = abs(math.atan2(person.y, person.x))
        return within_range and not hidden and bearing <= math.radians(self._config.fov_deg) / 2
