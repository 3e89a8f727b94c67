"""What a real sensor of people does and its data sheet does not say: `[sensor.faults]`."""

from __future__ import annotations

from collections.abc import Sequence

from mecazen.schema import Finite, NonNegative, Positive, Probability, Section


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
    """Time after which the noise correlates with itself by 1/e; its variance stays."""
    reported_noise_ratio: Positive = 1.0
    """Standard deviation that is reported, relative to the true one."""
    unsaid_latency_s: NonNegative = 0.0
    """Latency besides `sensor.latency_s`; whole ticks."""
    other_m: Finite = 0.0
    """A second person walks along, so far from the first along y of world; 0: nobody does."""
    other_seen: bool = True
    """Whether frames show the second person beside the first."""
    stand_ins_s: tuple[tuple[NonNegative, NonNegative], ...] = ()
    """Intervals [from, to] of simulated time in which the second person is seen for the first."""
    ids: bool = False
    """Whether the sensor names whom it sees; it confuses the names in `stand_ins_s`."""

    def __post_init__(self) -> None:
        check_intervals("faults.stand_ins_s", self.stand_ins_s)
        if self.stand_ins_s and not self.other_m:
            raise ValueError("faults.stand_ins_s needs faults.other_m: where who stands in walks")
