"""An estimate, what every estimator is made of, and the simplest one."""

import math

import numpy as np
import pytest
from follower.walks import DT, NOISE, make
from mecazen.config import FollowerConfig
from mecazen.geometry import Pose2D, Twist2D
from mecazen_follower.estimators import ESTIMATORS, Estimate, make_estimator


def test_none_holds_the_last_observation():
    estimator = make("none")
    estimator.update(Pose2D(1.0, 2.0, 3.0), NOISE)
    for _ in range(100):
        estimator.predict(DT)
    assert estimator.estimate.pose == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("unknown", [None, np.zeros((3, 3))])
def test_an_unknown_covariance_is_taken_from_the_parameters(unknown):
    estimator = make("kf_cv", position_std_m=0.2, yaw_std_deg=10.0)
    estimator.update(Pose2D(), unknown)
    variances = np.diag(estimator.estimate.covariance)
    assert variances == pytest.approx([0.04, 0.04, math.radians(10.0) ** 2])


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


@pytest.mark.parametrize("name", sorted(ESTIMATORS))
def test_every_estimator_is_made_by_its_name(name):
    params = FollowerConfig(estimator=name).estimator_params
    assert type(make_estimator(name, params)) is ESTIMATORS[name]
