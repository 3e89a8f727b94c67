"""Whether the sensor's real noise is learnt, and what good that does."""

import math

import numpy as np
import pytest
from follower.walks import FRAME_S as DT
from follower.walks import NOISE as REPORTED
from follower.walks import make
from mecazen.geometry import Pose2D, wrap
from mecazen_follower.estimators.ctrv import MAX_FACTOR, MIN_FACTOR, NoiseScale
from mecazen_follower.estimators.turn_rate import SEEN, move

PREDICTION = REPORTED / 5.0


def learn(factors, memory, frames):
    """Return who learnt from innovations of a sensor with these factors on its variances."""
    rng = np.random.default_rng(4)
    scale = NoiseScale(memory)
    real = np.diag(PREDICTION) + np.diag(REPORTED) * np.array([factors[0], *factors])
    for innovation in rng.normal(size=(frames, 3)) * np.sqrt(real):
        scale.learn(innovation, PREDICTION, REPORTED, DT)
    return scale


@pytest.mark.parametrize("factors", [(9.0, 9.0), (0.25, 0.25), (9.0, 0.25)])
def test_learns_how_much_worse_or_better_than_reported_the_sensor_is(factors):
    memory = 100.0
    position, yaw = learn(factors, memory, 20_000).factors  # 8 memories: e^-8 is left
    # An exponential mean of squares with variance s: its own deviation is s sqrt(2 w / 2),
    # for the mean of two of them s sqrt(w / 2). Four deviations: 1 in 16,000.
    w = DT / memory
    assert position == pytest.approx(factors[0], abs=4.0 * (factors[0] + 0.2) * math.sqrt(w / 2.0))
    assert yaw == pytest.approx(factors[1], abs=4.0 * (factors[1] + 0.2) * math.sqrt(w))


def test_the_covariance_is_scaled_with_its_correlations():
    noise = REPORTED.copy()
    noise[0, 1] = noise[1, 0] = 0.001
    noise[0, 2] = noise[2, 0] = 0.002
    scale = NoiseScale(1.0)
    scaled = scale.learn(np.array([0.3, 0.1, 0.5]), PREDICTION, noise, DT)
    position, yaw = scale.factors
    assert (position, yaw) != (1.0, 1.0)
    assert scaled[:2, :2] == pytest.approx(noise[:2, :2] * position)
    assert scaled[2, 2] == pytest.approx(noise[2, 2] * yaw)
    assert scaled[0, 2] == pytest.approx(noise[0, 2] * math.sqrt(position * yaw))


def test_one_frame_is_forgotten_exponentially():
    scale = NoiseScale(2.0)
    scale.learn(np.zeros(3), np.zeros((3, 3)), REPORTED, 1.0)
    # nothing where the reported noise was expected: 1 goes to 0 by e^(-1/2)
    assert scale.factors == pytest.approx((math.exp(-0.5), math.exp(-0.5)))


def test_with_a_memory_of_0_the_noise_is_as_reported_as_with_one_that_never_learns():
    estimators = [make("imm", noise_memory_s=memory) for memory in (0.0, 1e9)]
    for tick in range(50):
        for estimator in estimators:
            estimator.predict(DT)
            estimator.update(Pose2D((-1.0) ** tick, 0.0, 0.0), REPORTED)
    reported, never = (estimator.estimate for estimator in estimators)
    # of 1e9 s are 2 s passed: factors are 1 but for 2e-9 of excesses below 1000
    assert reported.pose == pytest.approx(never.pose, abs=1e-5)
    assert np.array(reported.covariance) == pytest.approx(np.array(never.covariance), rel=1e-5)


@pytest.mark.parametrize(("innovation", "bound"), [(0.0, MIN_FACTOR), (1e6, MAX_FACTOR)])
def test_factors_stay_within_bounds(innovation, bound):
    scale = NoiseScale(0.1)
    for _ in range(100):
        scale.learn(np.full(3, innovation), PREDICTION, REPORTED, DT)
    assert scale.factors == (bound, bound)


IMM = {
    "sway_m_sqrt_m": 0.03,
    "standing_yaw_std_rad": 0.2,
    "standing_s": 2.0,
    "straight_acceleration_std_m_s2": 0.02,
    "straight_yaw_std_rad": 0.01,
    "straight_s": 10.0,
    "turning_acceleration_std_m_s2": 0.02,
    "turning_yaw_acceleration_std_rad_s2": 0.02,
    "turning_s": 10.0,
    "manoeuvre_step_m_sqrt_s": 0.05,
    "manoeuvre_acceleration_std_m_s2": 2.0,
    "manoeuvre_yaw_acceleration_std_rad_s2": 3.0,
    "manoeuvre_s": 0.5,
}


def error_and_nees(memory):
    """Return mean position error [m] and NEES with a sensor 3 times worse than reported."""
    rng = np.random.default_rng(5)
    estimator = make("imm", **IMM, noise_memory_s=memory)
    state = np.array([0.0, 0.0, 0.0, 0.8, 0.0])
    errors, nees = [], []
    for frame in range(1500):  # a minute, in turns of 10 s straight and 10 s of a circle
        state[4] = 0.5 if frame % 500 < 250 else 0.0
        state = move(state, DT)
        x, y, yaw = (state[:SEEN] + 3.0 * rng.normal(size=3) * np.sqrt(np.diag(REPORTED))).tolist()
        estimator.predict(DT)
        estimator.update(Pose2D(x, y, wrap(yaw)), REPORTED)
        if frame < 250:
            continue
        pose, _, covariance = estimator.estimate
        error = state[:SEEN] - np.array(pose)
        error[2] = wrap(error[2])
        errors.append(math.hypot(*error[:2]))
        nees.append(error @ np.linalg.solve(np.array(covariance), error))
    return np.mean(errors), np.mean(nees)


def test_a_filter_that_learns_its_noise_is_better_and_knows_how_good_it_is():
    error, nees = error_and_nees(10.0)
    untaught_error, untaught_nees = error_and_nees(0.0)
    assert error < 0.7 * untaught_error
    # 3 degrees of freedom; the walk is not of the filter's own model, so half as much again
    # is granted either way, where 9 times the variance gives far more.
    assert 2.0 < nees < 4.5
    assert untaught_nees > 9.0
