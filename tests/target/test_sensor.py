"""The sensor's observations: their content, time and noise."""

import math
import statistics

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mecazen.config import SensorConfig
from mecazen.errors import ConfigError
from mecazen.geometry import Pose2D
from mecazen_target.sensor import NOISE_FRAMES, Frame, Sensor

TICK_S = 0.01
PERFECT = {"rate_hz": 100.0, "position_std_m": 0.0, "yaw_std_deg": 0.0}
ROBOT, PERSON = Pose2D(), Pose2D(1.0, 0.2, 0.3)


def sensor(seed: int = 0, **settings: object) -> Sensor:
    return Sensor(SensorConfig(**settings), seed, TICK_S)


def frames(sensor: Sensor, count: int, per_frame: int = 4) -> list[Frame]:
    seen = (sensor.observe(tick, ROBOT, PERSON) for tick in range(count * per_frame))
    return [frame for frame in seen if frame is not None]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rate_hz": 30.0}, "sensor.rate_hz = 30 must divide the tick rate"),
        ({"rate_hz": 200.0}, "sensor.rate_hz = 200 must divide the tick rate"),
        ({"latency_s": 0.015}, "sensor.latency_s: .* whole number of ticks"),
    ],
)
def test_rate_and_latency_must_be_whole_ticks(settings, message):
    with pytest.raises(ConfigError, match=message):
        sensor(**settings)


def test_tick_that_never_came_is_not_seen():
    eye = sensor(**PERFECT, latency_s=0.02)
    for tick in (0, 1):
        eye.observe(tick, ROBOT, PERSON)
    assert eye.observe(5, ROBOT, PERSON) == Frame(3, None)


@given(
    st.floats(-math.pi, math.pi), st.floats(0.1, 20.0), st.floats(-3.0, 3.0), st.floats(1.0, 359.0)
)
def test_person_is_seen_in_the_field_of_view_and_the_range(bearing, distance, robot_yaw, fov):
    robot = Pose2D(4.0, -2.0, robot_yaw)
    person = robot.compose(Pose2D(distance * math.cos(bearing), distance * math.sin(bearing)))
    eye = sensor(**PERFECT, fov_deg=fov, max_range_m=7.0)
    frame = eye.observe(0, robot, person)
    outside = max(abs(math.degrees(bearing)) - fov / 2, distance - 7.0)
    if abs(outside) > 1e-9:  # on the edge itself rounding decides
        assert (frame.pose is None) == (outside > 0.0)


def test_person_behind_is_seen_all_around():
    frame = sensor(**PERFECT, fov_deg=360.0).observe(0, ROBOT, Pose2D(-2.0, 0.0, 0.0))
    assert frame == Frame(0, Pose2D(-2.0, 0.0, 0.0))


def test_occlusion_hides_what_is_captured_from_its_begin_until_its_end():
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


def test_axes_and_neighbouring_frames_are_independent():
    eye = sensor(rate_hz=100.0, position_std_m=1.0)
    xs, ys = zip(*(f.pose[:2] for f in frames(eye, 20_000, 1) if f.pose is not None), strict=True)
    # A correlation of nothing has the standard error 1/sqrt(20000) = 0.007: 4 of them.
    assert abs(statistics.correlation(xs, ys)) < 0.03
    assert abs(statistics.correlation(xs[1:], xs[:-1])) < 0.03


def test_noise_starts_again_after_its_array():
    eye = sensor(rate_hz=100.0)
    first = eye.observe(0, ROBOT, PERSON)
    again = eye.observe(NOISE_FRAMES, ROBOT, PERSON)
    assert again.pose == first.pose


def test_dropouts_come_as_often_as_configured():
    eye = sensor(rate_hz=100.0, dropout_probability=0.3)
    dropped = statistics.fmean(f.pose is None for f in frames(eye, 10_000, 1))
    assert dropped == pytest.approx(0.3, abs=4 * math.sqrt(0.3 * 0.7 / 10_000))  # 4 deviations


@pytest.mark.parametrize(
    "hidden",
    [
        {"dropout_probability": 0.5},
        {"occlusions_s": ((1.0, 3.0),)},
        {"max_range_m": 1.0, "fov_deg": 10.0},
    ],
)
def test_what_is_hidden_does_not_change_the_noise_of_what_is_seen(hidden):
    all_seen, some_seen = frames(sensor(), 200), frames(sensor(**hidden), 200)
    assert any(f.pose is None for f in some_seen)
    assert all(b.pose is None or b == a for a, b in zip(all_seen, some_seen, strict=True))


def test_frame_holds_plain_floats_and_a_wrapped_yaw():
    eye = sensor(rate_hz=100.0, yaw_std_deg=90.0)
    for frame in frames(eye, 1000, 1):
        assert all(type(value) is float for value in frame.pose)
        assert -math.pi < frame.pose.yaw <= math.pi
