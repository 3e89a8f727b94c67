"""`[sensor]`: how the robot perceives the person, and the faults of that sensor."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated, Literal

import msgspec

from mecazen.schema import Finite, NonNegative, Positive, Probability, Section
from mecazen.ticks import ticks_per_sample

_FEATURES: dict[str, tuple[str, ...]] = {
    "pose": ("pose",),
    "body": ("skeleton", "tracker", "body"),
    "legs": ("skeleton", "lidar", "legs"),
    "fused": ("skeleton", "tracker", "body", "lidar", "legs"),
}


_BLIND = ("imu", "battery")
"""Sensors that do not perceive people, so they need no skeleton."""


def check_intervals(key: str, intervals: Sequence[tuple[float, float]]) -> None:
    """Raise ValueError if an interval does not end after it begins."""
    for begin, end in intervals:
        if end <= begin:
            raise ValueError(f"{key}: [{begin}, {end}] must end after it begins")


class SensorFaults(Section):
    """Faults of the robot's person sensor; by default there are none."""

    outlier_probability: Probability = 0.0
    """Chance of a frame to show the person `outlier_m` away, in any direction."""
    outlier_m: Positive = 2.0
    flip_probability: Probability = 0.0
    """Chance of a frame to show the person facing backwards."""
    noise_correlation_s: NonNegative = 0.0
    """Time after which the autocorrelation of the noise is 1/e; its variance is unchanged."""
    reported_noise_ratio: Positive = 1.0
    """Standard deviation that is reported, relative to the true one."""
    unsaid_latency_s: NonNegative = 0.0
    """Unreported latency in addition to `sensor.latency_s`; whole ticks."""
    other_m: Finite = 0.0
    """Distance of a second person from the first along y of world; 0: no second person."""
    other_seen: bool = True
    """Whether frames show the second person beside the first."""
    stand_ins_s: tuple[tuple[NonNegative, NonNegative], ...] = ()
    """Intervals [from, to] of simulated time in which the second person is seen in place of the
    first."""
    ids: bool = False
    """Whether the sensor identifies persons; in `stand_ins_s` it confuses their identities."""

    def __post_init__(self) -> None:
        check_intervals("faults.stand_ins_s", self.stand_ins_s)
        if self.stand_ins_s and not self.other_m:
            raise ValueError("faults.stand_ins_s needs faults.other_m: where who stands in walks")


class SensorConfig(Section):
    """How the robot perceives the person.

    The settings from `rate_hz` on are the data sheet of the sensor "pose", which target
    simulates; those of lidar and cameras are in `[sensors]`.
    """

    kind: Literal["pose", "body", "legs", "fused"] = "pose"
    """pose: the person's pose with noise; body: joints that a camera sees; legs: legs in a lidar's
    scan; fused: body and legs."""
    also: tuple[Literal["lidar", "tracker", "depth", "imu", "battery"], ...] = ()
    """Additional sensors, whose samples other programs can use."""
    rate_hz: Positive = 25.0
    """Frames a second; divides the tick rate."""
    frame: Literal["base_link", "world"] = "base_link"
    """Frame of the observed poses; world leaves out the drift of the odometry."""
    position_std_m: NonNegative = 0.05
    yaw_std_deg: NonNegative = 5.0
    latency_s: NonNegative = 0.0
    """From a frame's capture to its arrival; whole ticks."""
    fov_deg: Annotated[float, msgspec.Meta(gt=0.0, le=360.0)] = 360.0
    """Field of view about the robot's x axis."""
    max_range_m: Positive = 10.0
    dropout_probability: Probability = 0.0
    """Chance of a frame to show nothing."""
    occlusions_s: tuple[tuple[NonNegative, NonNegative], ...] = ()
    """Intervals [from, to] of simulated time in which nothing is seen."""
    faults: SensorFaults = SensorFaults()

    def __post_init__(self) -> None:
        check_intervals("occlusions_s", self.occlusions_s)

    @property
    def features(self) -> frozenset[str]:
        """The features of the graph that these sensors need."""
        return features(self.kind, self.also)

    def ticks_per_frame(self, tick_s: float) -> int:
        """Return the ticks from one frame to the next.

        Raises:
            ConfigError: The rate does not divide the tick rate.
        """
        return ticks_per_sample("sensor.rate_hz", self.rate_hz, tick_s)


def features(kind: str, also: Iterable[str]) -> frozenset[str]:
    """Return the features of the graph that sensors need; none for an unknown kind."""
    also = tuple(also)
    beside = ("skeleton",) if set(also) - set(_BLIND) else ()
    return frozenset((*_FEATURES.get(kind, ()), *beside, *also))
