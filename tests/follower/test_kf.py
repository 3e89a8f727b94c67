"""The linear filters against numbers by hand, filterpy's filter, and the motion that they find."""

import math

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from follower.walks import DT, NOISE, make, walk
from hypothesis import given
from hypothesis import strategies as st
from mecazen.geometry import Pose2D, Twist2D, wrap


def test_displacement_filter_moves_a_person_at_yaw_zero():
    # Taken literally, F would move them by yaw times the displacement: not at all.
    estimator = make("kf_displacement")
    walk(estimator, 10.0, Twist2D(0.2, 0.0, 0.0))
    before = estimator.estimate
    for _ in range(100):
        estimator.predict(DT)
    after = estimator.estimate
    assert before.velocity.x == pytest.approx(0.2, rel=0.01)  # e^-10 of the smoothing is left
    assert after.pose.x - before.pose.x == pytest.approx(before.velocity.x)
    assert after.pose.yaw == pytest.approx(0.0, abs=1e-6)


def test_displacement_filter_is_filterpys_told_tick_by_tick():
    estimator = make("kf_displacement", position_drift_m_sqrt_s=0.5)
    walk(estimator, 2.0, Twist2D(0.3, 0.0, 0.2))
    pose, velocity, covariance = estimator.estimate
    reference = KalmanFilter(3, 2)
    reference.x, reference.P = np.array(pose), np.array(covariance)
    reference.H = np.eye(2, 3)
    for _ in range(10):
        estimator.predict(DT)
        noise = np.diag([0.25 * DT, 0.25 * DT, 0.0])
        reference.predict(u=np.array([velocity.x, velocity.y, 0.0]) * DT, B=np.eye(3), Q=noise)
        assert estimator.estimate.pose == pytest.approx(reference.x, abs=1e-12)
        assert np.array(estimator.estimate.covariance) == pytest.approx(reference.P, abs=1e-12)
    seen = Pose2D(pose.x + 0.1, pose.y - 0.2, pose.yaw)
    estimator.update(seen, NOISE)
    reference.update(np.array(seen[:2]), R=NOISE[:2, :2])
    assert estimator.estimate.pose[:2] == pytest.approx(reference.x[:2], abs=1e-9)


def test_displacement_filter_takes_the_direction_of_motion_for_the_yaw():
    estimator = make("kf_displacement")
    # The observed yaw says 0, the motion 90 degrees.
    walk(estimator, 8.0, Twist2D(0.0, 0.5, 0.0))
    assert estimator.estimate.pose.yaw == pytest.approx(math.pi / 2)


def test_displacement_filter_takes_the_observed_yaw_of_who_stands():
    estimator = make("kf_displacement")
    estimator.update(Pose2D(0.0, 0.0, 3.0), NOISE)
    walk(estimator, 15.0, Twist2D(), Pose2D(0.0, 0.0, -3.0))
    assert estimator.estimate.pose.yaw == pytest.approx(-3.0, abs=1e-3)


# P[x, x] = 0.0125 both times: 0.0025 + 0.25 * 0.04 of drift, or + 1 * 0.1² of the first speed;
# so S = 0.015, K = 5/6, x = 1/12 and NIS = 0.01 / 0.015. The speed is (1 - e^-0.02) * x / 0.04
# of the smoothing, or 0.1 / S of 0.1 m.
@pytest.mark.parametrize(
    ("name", "params", "after_s", "speed"),
    [
        (
            "kf_displacement",
            {"position_drift_m_sqrt_s": 0.5, "smoothing_s": 2.0},
            0.04,
            (1 - math.exp(-0.02)) / 0.48,
        ),
        ("kf_cv", {"acceleration_std_m_s2": 1e-6}, 0.1, 2 / 3),
    ],
)
def test_a_linear_filter_corrects_by_the_gain_computed_by_hand(name, params, after_s, speed):
    estimator = make(name, **params)
    estimator.update(Pose2D(), NOISE)
    estimator.predict(after_s)
    estimator.update(Pose2D(0.1, 0.0, 0.0), NOISE)
    assert estimator.estimate.pose.x == pytest.approx(1 / 12)
    assert estimator.estimate.velocity.x == pytest.approx(speed)
    assert estimator.estimate.covariance[0][0] == pytest.approx(0.0125 / 6)
    assert estimator.nis == pytest.approx(2 / 3)


def test_constant_velocity_filter_finds_the_velocity_and_keeps_it_while_coasting():
    estimator = make("kf_cv")
    velocity = Twist2D(-0.8, 0.6, 0.4)
    last = walk(estimator, 20.0, velocity, Pose2D(1.0, 2.0, 3.0))
    assert estimator.estimate.velocity == pytest.approx(velocity, abs=1e-6)
    for _ in range(103):
        estimator.predict(DT)
    # The walk ended with a predicted tick, so the filter is 103 ticks on.
    pose = estimator.estimate.pose
    assert pose.x == pytest.approx(last.x - 0.8 * 1.03, abs=1e-6)
    assert pose.y == pytest.approx(last.y + 0.6 * 1.03, abs=1e-6)
    assert wrap(pose.yaw - last.yaw - 0.4 * 1.03) == pytest.approx(0.0, abs=1e-6)


@given(st.integers(1, 20))
def test_constant_velocity_prediction_does_not_depend_on_the_step(parts):
    whole, divided = make("kf_cv"), make("kf_cv")
    for estimator in (whole, divided):
        walk(estimator, 1.0, Twist2D(0.5, 0.2, 0.1))
    whole.predict(0.2)
    for _ in range(parts):
        divided.predict(0.2 / parts)
    assert np.allclose(whole.estimate.pose, divided.estimate.pose, atol=1e-9)
    assert np.allclose(whole.estimate.covariance, divided.estimate.covariance, atol=1e-9)
