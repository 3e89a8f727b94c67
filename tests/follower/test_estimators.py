"""What every estimator does: across the wrap, without noise, with wrong observations."""

import math

import numpy as np
import pytest
from follower.walks import DT, NOISE, make, walk
from hypothesis import given
from hypothesis import strategies as st
from mecazen.geometry import Pose2D, Twist2D, wrap
from mecazen_follower.estimators import ESTIMATORS, Estimate


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


@pytest.mark.parametrize("unknown", [None, np.zeros((3, 3))])
def test_an_unknown_covariance_is_taken_from_the_parameters(unknown):
    estimator = make("kf_cv", position_std_m=0.2, yaw_std_deg=10.0)
    estimator.update(Pose2D(), unknown)
    variances = np.diag(estimator.estimate.covariance)
    assert variances == pytest.approx([0.04, 0.04, math.radians(10.0) ** 2])


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


def test_an_estimate_looks_ahead_along_a_straight_line():
    estimate = Estimate(Pose2D(1.0, 2.0, 3.1), Twist2D(1.0, -2.0, 0.0), ())
    assert estimate.after(0.2).pose == pytest.approx((1.2, 1.6, 3.1))
    assert estimate.after(0.2).velocity == pytest.approx((1.0, -2.0, 0.0))


def test_an_estimate_looks_ahead_along_an_arc_across_the_wrap():
    # a quarter of a circle of 2 m to the left, from heading -x to heading -y
    estimate = Estimate(Pose2D(1.0, 2.0, math.pi), Twist2D(-1.0, 0.0, 0.5), ())
    after = estimate.after(math.pi)
    assert after.pose == pytest.approx((-1.0, 0.0, -math.pi / 2.0))
    assert after.velocity == pytest.approx((0.0, -1.0, 0.5), abs=1e-12)


def test_ahead_by_nothing_is_the_estimate(estimator):
    assert estimator.ahead(0.2) is None
    walk(estimator, 2.0, Twist2D(1.0, 0.5, 0.2))
    now, then = estimator.estimate, estimator.ahead(0.0)
    assert then.pose == pytest.approx(now.pose)
    assert then.velocity == pytest.approx(now.velocity)


def test_looking_ahead_changes_nothing(estimator):
    walk(estimator, 2.0, Twist2D(1.0, 0.5, 0.2))
    before = estimator.estimate
    estimator.ahead(0.5)
    assert estimator.estimate == before


def test_after_a_reset_all_is_as_at_first_to_the_last_bit(estimator):
    walk(estimator, 2.0, Twist2D(1.0, 0.5, 0.2))
    first = estimator.estimate
    estimator.reset()
    assert (estimator.estimate, estimator.nis) == (None, None)
    walk(estimator, 2.0, Twist2D(1.0, 0.5, 0.2))
    assert estimator.estimate == first


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
