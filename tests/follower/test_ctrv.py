"""The turn rate filters: the noise that they learn, and where they expect the person."""

import math

import numpy as np
import pytest
from follower.walks import DT, FRAME_S, MATCHED, NOISE, frame, make, walk
from mecazen.geometry import Pose2D, Twist2D, rotate
from mecazen_follower.estimators.ctrv import MAX_FACTOR, MIN_FACTOR, NoiseScale

PREDICTION = NOISE / 5.0


def learn(factors, memory, frames):
    """Return who learnt from innovations of a sensor with these factors on its variances."""
    rng = np.random.default_rng(4)
    scale = NoiseScale(memory)
    real = np.diag(PREDICTION) + np.diag(NOISE) * np.array([factors[0], *factors])
    for innovation in rng.normal(size=(frames, 3)) * np.sqrt(real):
        scale.learn(innovation, PREDICTION, NOISE, FRAME_S)
    return scale


@pytest.mark.parametrize("factors", [(9.0, 9.0), (0.25, 0.25), (9.0, 0.25)])
def test_learns_how_much_worse_or_better_than_reported_the_sensor_is(factors):
    memory = 100.0
    position, yaw = learn(factors, memory, 20_000).factors  # 8 memories: e^-8 is left
    # An exponential mean of squares with variance s: its own deviation is s sqrt(2 w / 2),
    # for the mean of two of them s sqrt(w / 2). Four deviations: 1 in 16,000.
    w = FRAME_S / memory
    assert position == pytest.approx(factors[0], abs=4.0 * (factors[0] + 0.2) * math.sqrt(w / 2.0))
    assert yaw == pytest.approx(factors[1], abs=4.0 * (factors[1] + 0.2) * math.sqrt(w))


def test_the_covariance_is_scaled_with_its_correlations():
    noise = NOISE.copy()
    noise[0, 1] = noise[1, 0] = 0.001
    noise[0, 2] = noise[2, 0] = 0.002
    scale = NoiseScale(1.0)
    scaled = scale.learn(np.array([0.3, 0.1, 0.5]), PREDICTION, noise, FRAME_S)
    position, yaw = scale.factors
    assert (position, yaw) != (1.0, 1.0)
    assert scaled[:2, :2] == pytest.approx(noise[:2, :2] * position)
    assert scaled[2, 2] == pytest.approx(noise[2, 2] * yaw)
    assert scaled[0, 2] == pytest.approx(noise[0, 2] * math.sqrt(position * yaw))


def test_one_frame_is_forgotten_exponentially():
    scale = NoiseScale(2.0)
    scale.learn(np.zeros(3), np.zeros((3, 3)), NOISE, 1.0)
    # nothing where the reported noise was expected: 1 goes to 0 by e^(-1/2)
    assert scale.factors == pytest.approx((math.exp(-0.5), math.exp(-0.5)))


def test_with_a_memory_of_0_the_noise_is_as_reported_as_with_one_that_never_learns():
    estimators = [make("imm", noise_memory_s=memory) for memory in (0.0, 1e9)]
    for tick in range(50):
        for estimator in estimators:
            estimator.predict(FRAME_S)
            estimator.update(Pose2D((-1.0) ** tick, 0.0, 0.0), NOISE)
    reported, never = (estimator.estimate for estimator in estimators)
    # of 1e9 s are 2 s passed: factors are 1 but for 2e-9 of excesses below 1000
    assert reported.pose == pytest.approx(never.pose, abs=1e-5)
    assert np.array(reported.covariance) == pytest.approx(np.array(never.covariance), rel=1e-5)


@pytest.mark.parametrize(("innovation", "bound"), [(0.0, MIN_FACTOR), (1e6, MAX_FACTOR)])
def test_factors_stay_within_bounds(innovation, bound):
    scale = NoiseScale(0.1)
    for _ in range(100):
        scale.learn(np.full(3, innovation), PREDICTION, NOISE, FRAME_S)
    assert scale.factors == (bound, bound)


@pytest.mark.parametrize("turn", [0.0, 0.5, -0.5])
def test_latency_is_made_up_for_exactly_on_a_straight_line_and_an_arc(turn):
    estimator, pose = make("ekf_ctrv", **MATCHED), Pose2D(1.0, 2.0, 3.0)
    twist = Twist2D(0.8, 0.0, turn)
    for _ in range(1000):  # 40 s without noise: nothing of the start is left
        pose = pose.integrate(twist, FRAME_S)
        frame(estimator, pose)
    later, ahead = pose.integrate(twist, 0.2), estimator.ahead(0.2)
    assert ahead.pose == pytest.approx(later, abs=1e-9)
    assert ahead.velocity[:2] == pytest.approx(rotate(0.8, 0.0, later.yaw), abs=1e-9)
    assert np.trace(ahead.covariance) > np.trace(estimator.estimate.covariance)


def test_many_short_predictions_are_one_long_one():
    whole, divided = make("ekf_ctrv", **MATCHED), make("ekf_ctrv", **MATCHED)
    for estimator in (whole, divided):
        walk(estimator, 2.0, Twist2D(0.5, 0.0, 0.0))
    whole.predict(0.08)
    for _ in range(8):
        divided.predict(DT)
    assert divided.estimate.pose == pytest.approx(whole.estimate.pose, abs=1e-12)


@pytest.mark.parametrize("name", ["imm", "ekf_ctrv"])
def test_a_reset_forgets_the_learnt_noise(name):
    fresh, used = make(name, noise_memory_s=1.0), make(name, noise_memory_s=1.0)
    for tick in range(50):
        used.predict(DT)
        used.update(Pose2D((-1.0) ** tick, 0.0, 0.0), NOISE)
    used.reset()
    for estimator in (fresh, used):
        walk(estimator, 1.0, Twist2D(1.0, 0.5, 0.2))
    assert used.estimate == fresh.estimate
