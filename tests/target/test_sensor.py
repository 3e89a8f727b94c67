"""The sensor's observations: their content, time, noise and faults."""

import math
import statistics

import numpy as np
import pytest
from mecazen.config import SensorConfig, SensorFaults
from mecazen.geometry import Pose2D, wrap
from mecazen_target.sensor import NOISE_FRAMES, Sensor, SensorFrame

TICK_S = 0.01
PERFECT = {"rate_hz": 100.0, "position_std_m": 0.0, "yaw_std_deg": 0.0}
ROBOT, PERSON = Pose2D(), Pose2D(1.0, 0.2, 0.3)


def sensor(seed: int = 0, **settings: object) -> Sensor:
    return Sensor(SensorConfig(**settings), seed, TICK_S)


def frames(sensor: Sensor, count: int, per_frame: int = 4) -> list[SensorFrame]:
    seen = (sensor.observe(tick, ROBOT, PERSON) for tick in range(count * per_frame))
    return [frame for frame in seen if frame is not None]


@pytest.mark.parametrize(
    ("bearing_deg", "distance", "settings", "reason"),
    [
        (0.0, 1.0, {}, ""),
        (50.0, 1.0, {}, "out of view to the left"),
        (-50.0, 1.0, {}, "out of view to the right"),
        (50.0, 8.0, {}, "out of range"),
        (0.0, 1.0, {"occlusions_s": ((0.0, 1.0),)}, "the sensor sees nothing"),
        (0.0, 1.0, {"dropout_probability": 1.0}, "the sensor sees nothing"),
    ],
)
def test_a_frame_without_the_person_gives_the_reason(bearing_deg, distance, settings, reason):
    bearing = math.radians(bearing_deg)
    person = ROBOT.compose(Pose2D(distance * math.cos(bearing), distance * math.sin(bearing)))
    eye = sensor(**PERFECT, fov_deg=80.0, max_range_m=7.0, **settings)
    frame = eye.observe(0, ROBOT, person)
    assert (frame.reason, frame.pose is None) == (reason, bool(reason))


def test_occlusion_hides_captures_between_its_ends():
    eye = sensor(**PERFECT, latency_s=0.02, occlusions_s=((0.05, 0.08), (0.1, 0.11)))
    captured = {}
    for tick in range(20):
        frame = eye.observe(tick, ROBOT, PERSON)
        captured[frame.capture_tick] = frame.pose
    assert [tick for tick, pose in captured.items() if pose is None] == [5, 6, 7, 10]


def test_noise_has_the_configured_spread_and_no_bias():
    eye = sensor(seed=7, rate_hz=100.0, position_std_m=0.05, yaw_std_deg=5.0)
    seen = [frame.pose for frame in frames(eye, NOISE_FRAMES, 1)]
    true = ROBOT.between(PERSON)
    for axis, std in enumerate((0.05, 0.05, math.radians(5.0))):
        errors = [pose[axis] - true[axis] for pose in seen if pose is not None]
        # Standard errors are 1/sqrt(n) of the mean and 1/sqrt(2n) of the deviation: 4 of each.
        assert statistics.fmean(errors) == pytest.approx(0.0, abs=4 * std / 256)
        assert statistics.stdev(errors) == pytest.approx(std, rel=4 / 362)
        # of frames that follow each other: a standard error of 1/256
        assert abs(statistics.correlation(errors[1:], errors[:-1])) < 4 / 256


def faulty(count, faults, **settings):
    """Return the frames of as many ticks."""
    config = SensorConfig(**{**PERFECT, **settings}, faults=SensorFaults(**faults))
    sensor = Sensor(config, 1, TICK_S)
    return [sensor.observe(tick, ROBOT, PERSON) for tick in range(count)], sensor


def test_noise_depends_on_time_and_repeats():
    eye = sensor(rate_hz=100.0)
    first = eye.observe(0, ROBOT, PERSON)
    assert eye.observe(NOISE_FRAMES, ROBOT, PERSON).pose == first.pose
    all_seen, some_seen = frames(sensor(), 200), frames(sensor(dropout_probability=0.5), 200)
    assert any(frame.pose is None for frame in some_seen)
    assert all(b.pose is None or b == a for a, b in zip(all_seen, some_seen, strict=True))


def test_outliers_and_flips_come_with_their_probabilities():
    seen, _ = faulty(5000, {"outlier_probability": 0.02, "flip_probability": 0.03})
    out = [frame.pose for frame in seen if PERSON.distance(frame.pose) > 1e-9]
    # 100 of 5000 with a deviation of 10, and 150 with one of 12
    assert len(out) == pytest.approx(100, abs=40)
    assert [PERSON.distance(pose) for pose in out] == pytest.approx([2.0] * len(out))
    x, y = (np.array([getattr(pose, axis) for pose in out]) for axis in ("x", "y"))
    assert abs(x.mean() - PERSON.x) < 0.6
    assert abs(y.mean() - PERSON.y) < 0.6
    turned = [abs(wrap(frame.pose.yaw - PERSON.yaw)) for frame in seen]
    assert sum(turn > 3.0 for turn in turned) == pytest.approx(150, abs=50)


def test_correlated_noise_keeps_its_variance_and_decays():
    seen, _ = faulty(60_000, {"noise_correlation_s": 0.5}, position_std_m=0.05)
    x = np.array([frame.pose.x for frame in seen]) - PERSON.x
    # 600 s are some 600 independent halves of a second: the variance is known to 6 %
    assert x.std() == pytest.approx(0.05, rel=0.1)
    assert (x[50:] * x[:-50]).mean() / x.var() == pytest.approx(math.exp(-1.0), abs=0.1)


def test_wrong_data_sheet_changes_only_the_report():
    noisy = {"position_std_m": 0.05, "yaw_std_deg": 5.0}
    right, sheet = faulty(100, {}, **noisy)
    wrong, liar = faulty(100, {"reported_noise_ratio": 0.5}, **noisy)
    assert wrong == right
    assert liar.covariance == pytest.approx([number / 4.0 for number in sheet.covariance])


def test_an_unsaid_latency_is_in_the_stamp():
    seen, _ = faulty(30, {"unsaid_latency_s": 0.1}, latency_s=0.05)
    assert [frame.capture_tick for frame in seen[15:]] == list(range(15))


def test_a_second_person_walks_beside_and_stands_in():
    faults = {"other_m": 1.0, "stand_ins_s": ((0.1, 0.2),)}
    beside = PERSON._replace(y=PERSON.y + 1.0)
    seen, _ = faulty(30, faults)
    for frame in (*seen[:10], *seen[20:]):
        assert (frame.pose, frame.second) == (PERSON, beside)
    assert {frame.second_first for frame in seen} == {False, True}
    assert {(frame.pose, frame.second) for frame in seen[10:20]} == {(beside, None)}
    alone, _ = faulty(10, {**faults, "other_seen": False})
    assert all(frame.second is None for frame in alone)
