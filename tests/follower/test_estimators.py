"""Properties of every estimator, and whether its errors match its covariance."""

import math

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from follower.walks import DT, FRAME_S, NOISE, frame, make, simulate_turning, total_nees, walk
from hypothesis import given
from hypothesis import strategies as st
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen_follower.estimators import ESTIMATORS
from scipy.stats import chi2


@pytest.fixture(params=sorted(ESTIMATORS))
def estimator(request):
    return make(request.param)


def test_before_the_first_observation_there_is_no_estimate(estimator):
    estimator.predict(DT)
    assert estimator.estimate is None
    assert estimator.nis is None


def test_first_observation_is_the_estimate(estimator):
    estimator.update(Pose2D(1.0, -2.0, 3.0), NOISE)
    assert estimator.estimate.pose == pytest.approx((1.0, -2.0, 3.0))
    assert estimator.estimate.velocity == Twist2D()
    assert np.asarray(estimator.estimate.covariance) == pytest.approx(NOISE)


def test_estimate_is_made_of_plain_floats(estimator):
    walk(estimator, 0.5, Twist2D(1.0, 0.0, 0.1))
    pose, velocity, covariance = estimator.estimate
    numbers = [*pose, *velocity, *(number for row in covariance for number in row)]
    assert {type(number) for number in numbers} == {float}
    assert len(numbers) == 15


def test_yaw_across_the_wrap_is_no_jump(estimator):
    # Walking towards -x, the direction of motion too is near ±pi.
    for tick in range(200):
        estimator.predict(DT)
        side = math.pi - 0.02 if tick % 2 else -math.pi + 0.02
        estimator.update(Pose2D(-0.5 * tick * DT, 0.0, side), NOISE)
        assert abs(wrap(estimator.estimate.pose.yaw - math.pi)) < 0.03
        assert -math.pi < estimator.estimate.pose.yaw <= math.pi


def test_a_sensor_without_noise_is_fine(estimator):
    perfect = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1e-9]]
    for _ in range(3):
        estimator.update(Pose2D(1.0, 2.0, 0.5), perfect)
    estimator.predict(DT)
    estimator.update(Pose2D(1.0, 2.0, 0.5), perfect)
    assert estimator.estimate.pose == pytest.approx((1.0, 2.0, 0.5), abs=1e-6)


coordinate = st.floats(-1e6, 1e6)


@given(
    st.sampled_from(sorted(ESTIMATORS)),
    st.lists(
        st.tuples(coordinate, coordinate, st.floats(-100.0, 100.0), st.floats(0.001, 5.0)),
        max_size=20,
    ),
)
def test_whatever_is_observed_the_estimate_is_finite(name, observations):
    estimator = make(name)
    for x, y, yaw, dt in observations:
        estimator.predict(dt)
        estimator.update(Pose2D(x, y, yaw), NOISE)
        pose, velocity, covariance = estimator.estimate
        assert np.isfinite([*pose, *velocity]).all()
        assert (np.diag(covariance) > 0.0).all()


def test_ahead_by_nothing_is_the_estimate_and_looking_ahead_changes_nothing(estimator):
    assert estimator.ahead(0.2) is None
    walk(estimator, 2.0, Twist2D(1.0, 0.5, 0.2))
    now, then = estimator.estimate, estimator.ahead(0.0)
    assert then.pose == pytest.approx(now.pose)
    assert then.velocity == pytest.approx(now.velocity)
    estimator.ahead(0.5)
    assert estimator.estimate == now


def test_after_a_reset_all_is_as_at_first_to_the_last_bit(estimator):
    walk(estimator, 2.0, Twist2D(1.0, 0.5, 0.2))
    first = estimator.estimate
    estimator.reset()
    assert (estimator.estimate, estimator.nis) == (None, None)
    walk(estimator, 2.0, Twist2D(1.0, 0.5, 0.2))
    assert estimator.estimate == first


def simulate_constant_velocity(seconds, rng, std=0.4, yaw_std=0.3):
    """Yield truth, estimate and NIS after each update; the truth moves as the filter thinks."""
    estimator = make("kf_cv", acceleration_std_m_s2=std, yaw_acceleration_std_rad_s2=yaw_std)
    step = np.array([[1.0, DT], [0.0, 1.0]])
    root = np.linalg.cholesky(Q_continuous_white_noise(2, DT, 1.0))
    scale = np.array([[std], [std], [yaw_std]])
    state = np.column_stack([rng.normal(size=3) * 5.0, rng.normal(size=3) * [1.0, 1.0, 0.5]])
    for tick in range(round(seconds / DT)):
        if tick % 4 == 0:
            seen = state[:, 0] + rng.normal(size=3) * np.sqrt(np.diag(NOISE))
            estimator.update(Pose2D(seen[0], seen[1], wrap(seen[2])), NOISE)
            yield state[:, 0], estimator.estimate, estimator.nis
        estimator.predict(DT)
        state = state @ step.T + scale * (rng.normal(size=(3, 2)) @ root.T)


def test_nis_of_a_wrong_model_is_not():
    # The same bound does find a filter that believes its sensor too much.
    rng = np.random.default_rng(9)
    estimator = make("kf_cv")
    nis = []
    for _ in range(500):
        estimator.predict(DT)
        estimator.update(Pose2D(*(rng.normal(size=3) * 0.1).tolist()), np.eye(3) * 0.05**2)
        nis.append(estimator.nis or 0.0)
    assert sum(nis) > chi2.ppf(0.9995, 3 * len(nis))


MATCHED_MODELS = pytest.mark.parametrize(
    "simulate",
    [
        pytest.param(simulate_constant_velocity, id="kf_cv"),
        pytest.param(simulate_turning, id="ekf_ctrv"),
    ],
)


@MATCHED_MODELS
def test_nees_of_the_matched_model_is_chi_square(simulate):
    # 100 independent runs, 3 degrees of freedom each; two-sided 99.9 %
    assert chi2.ppf(0.0005, 300) < total_nees(simulate, 100) < chi2.ppf(0.9995, 300)


@MATCHED_MODELS
def test_nis_of_the_matched_model_is_chi_square(simulate):
    # Innovations of a right filter are white, so one run will do; two-sided 99.9 %.
    _, *nis = [nis for _, _, nis in simulate(40.0, np.random.default_rng(8))]
    assert chi2.ppf(0.0005, 3 * len(nis)) < sum(nis) < chi2.ppf(0.9995, 3 * len(nis))


SLOW = 0.2
HEADING = {
    "ekf_ctrv": {
        "sway_m_sqrt_m": 0.001,
        "acceleration_std_m_s2": 0.001,
        "yaw_acceleration_std_rad_s2": 0.001,
    },
    "imm": {},
    "kf_cv": {"acceleration_std_m_s2": 0.02, "yaw_acceleration_std_rad_s2": 0.02},
}


def heading_error(name, seconds=15.0):
    """Return the rms of the heading's error [rad] after a slow straight walk, of ten walks.

    The sensor is good for 5 cm and for 65 degrees.
    """
    noise = np.diag([0.05**2, 0.05**2, math.radians(65.0) ** 2])
    squares = []
    for seed in range(10):
        rng, estimator = np.random.default_rng(seed), make(name, **HEADING[name])
        heading = rng.uniform(-math.pi, math.pi)
        for number in range(round(seconds / FRAME_S)):
            way = SLOW * number * FRAME_S
            pose = np.array([way * math.cos(heading), way * math.sin(heading), heading])
            frame(estimator, pose + rng.normal(size=3) * np.sqrt(np.diag(noise)), noise)
        squares.append(wrap(estimator.estimate.pose.yaw - heading) ** 2)
    return math.sqrt(np.mean(squares))


def test_the_heading_is_known_from_the_motion_where_model_and_motion_are_tied():
    # A line fitted to the positions has a slope of σ sqrt(12 / (rate T³)): 0.17 degrees. Who
    # may also turn is fitted a parabola, whose end slope is 4 times as uncertain: 0.68. Three
    # times that is granted, since the filters forget a little: 2 degrees.
    parabola = 4.0 * 0.05 * math.sqrt(12.0 * FRAME_S / 15.0**3) / SLOW
    assert heading_error("imm") < 3.0 * parabola
    assert heading_error("ekf_ctrv") < 3.0 * parabola
    assert heading_error("kf_cv") > 6.0 * parabola
