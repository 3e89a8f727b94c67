"""What the sensor does that its data sheet does not say."""

import math

import numpy as np
import pytest
from mecazen.config import SensorConfig, SensorFaults
from mecazen.geometry import Pose2D, wrap
from mecazen_target.sensor import Sensor

TICK_S = 0.01
ROBOT, PERSON = Pose2D(), Pose2D(1.0, 0.2, 0.3)
EXACT = {"rate_hz": 100.0, "position_std_m": 0.0, "yaw_std_deg": 0.0}


def frames(count, faults, **settings):
    """Return the frames of as many ticks."""
    config = SensorConfig(**{**EXACT, **settings}, faults=SensorFaults(**faults))
    sensor = Sensor(config, 1, TICK_S)
    return [sensor.observe(tick, ROBOT, PERSON) for tick in range(count)], sensor


def test_outliers_lie_2_m_away_in_any_direction():
    seen, _ = frames(5000, {"outlier_probability": 0.02})
    off = [PERSON.distance(frame.pose) for frame in seen]
    out = [frame.pose for frame, way in zip(seen, off, strict=True) if way > 1e-9]
    # 100 of 5000 with a deviation of 10
    assert len(out) == pytest.approx(100, abs=40)
    assert [PERSON.distance(pose) for pose in out] == pytest.approx([2.0] * len(out))
    x, y = (np.array([getattr(pose, axis) for pose in out]) for axis in ("x", "y"))
    assert abs(x.mean() - PERSON.x) < 0.6
    assert abs(y.mean() - PERSON.y) < 0.6


def test_flips_show_the_person_from_behind():
    seen, _ = frames(5000, {"flip_probability": 0.03})
    turned = [abs(wrap(frame.pose.yaw - PERSON.yaw)) for frame in seen]
    assert sum(turn > 3.0 for turn in turned) == pytest.approx(150, abs=50)
    assert all(turn == pytest.approx(math.pi) or turn < 1e-9 for turn in turned)


def test_correlated_noise_has_the_same_variance_and_decays_as_said():
    seen, _ = frames(60_000, {"noise_correlation_s": 0.5}, position_std_m=0.05)
    x = np.array([frame.pose.x for frame in seen]) - PERSON.x
    # 600 s are some 600 independent halves of a second: the variance is known to 6 %
    assert x.std() == pytest.approx(0.05, rel=0.1)
    assert (x[50:] * x[:-50]).mean() / x.var() == pytest.approx(math.exp(-1.0), abs=0.1)


def test_a_wrong_data_sheet_changes_the_report_and_not_the_noise():
    noisy = {"position_std_m": 0.05, "yaw_std_deg": 5.0}
    right, sheet = frames(100, {}, **noisy)
    wrong, liar = frames(100, {"reported_noise_ratio": 0.5}, **noisy)
    assert wrong == right
    assert liar.covariance == pytest.approx([number / 4.0 for number in sheet.covariance])


def test_an_unsaid_latency_is_in_the_stamp():
    seen, _ = frames(30, {"unsaid_latency_s": 0.1}, latency_s=0.05)
    assert [frame.capture_tick for frame in seen[15:]] == list(range(15))


def test_a_second_person_walks_beside_and_stands_in():
    faults = {"other_m": 1.0, "stand_ins_s": ((0.1, 0.2),)}
    beside = PERSON._replace(y=PERSON.y + 1.0)
    seen, _ = frames(30, faults)
    for frame in (*seen[:10], *seen[20:]):
        assert (frame.pose, frame.other) == (PERSON, beside)
    assert {frame.other_first for frame in seen} == {False, True}
    assert {(frame.pose, frame.other) for frame in seen[10:20]} == {(beside, None)}
    alone, _ = frames(10, {**faults, "other_seen": False})
    assert all(frame.other is None for frame in alone)


@pytest.mark.parametrize(
    ("faults", "message"),
    [
        ({"stand_ins_s": ((1.0, 2.0),)}, "needs faults.other_m"),
        ({"other_m": 1.0, "stand_ins_s": ((2.0, 1.0),)}, "must end after it begins"),
    ],
)
def test_a_stand_in_needs_somebody_and_some_time(faults, message):
    with pytest.raises(ValueError, match=message):
        SensorFaults(**faults)
