"""The unscented filter beside the extended one, and against its own statistics."""

import numpy as np
import pytest
from follower.walks import FRAME_S, MATCHED, frame, make, simulate_turning, total_nees
from harness import SCENARIOS
from mecazen.geometry import Pose2D, Twist2D, rotate, wrap
from mecazen.loading import load_scenario, parse_settings
from mecazen_experiments.estimators import Follower
from mecazen_follower.estimators.imm import ctrv
from scipy.stats import chi2

UKF = "ukf_ctrv"


def test_a_scenario_that_names_the_program_may_select_it():
    settings = (
        f"programs.follower='{Follower.__module__}:{Follower.__name__}'",
        f"follower.estimator='{UKF}'",
    )
    config = load_scenario(SCENARIOS / "back.toml", parse_settings(settings)).follower
    assert make(config.estimator, **config.estimator_params).estimate is None


def test_it_agrees_with_the_extended_filter_where_the_noise_is_small():
    rng = np.random.default_rng(1)
    filters = [make(name, **MATCHED) for name in ("ekf_ctrv", UKF)]
    state = np.array([0.0, 0.0, 0.0, 0.8, 0.5])
    for _ in range(250):
        state, _ = ctrv(state, FRAME_S)
        seen = state[:3] + 0.001 * rng.normal(size=3)
        for estimator in filters:
            frame(estimator, seen, np.eye(3) * 0.001**2)
        extended, unscented = (estimator.estimate for estimator in filters)
        apart = np.array(unscented.pose) - np.array(extended.pose)
        apart[2] = wrap(apart[2])
        # they differ in the second order: v times the heading's variance of 1e-6
        assert (np.abs(apart) < 1e-5 * np.sqrt(np.diag(extended.covariance))).all()


def test_nees_and_nis_are_chi_square_where_the_person_moves_as_the_filter_assumes():
    # 100 independent runs, 3 degrees of freedom each; two-sided 99.9 %
    total = total_nees(lambda seconds, rng: simulate_turning(seconds, rng, UKF), 100)
    assert chi2.ppf(0.0005, 300) < total < chi2.ppf(0.9995, 300)
    _, *nis = [nis for _, _, nis in simulate_turning(40.0, np.random.default_rng(8), UKF)]
    assert chi2.ppf(0.0005, 3 * len(nis)) < sum(nis) < chi2.ppf(0.9995, 3 * len(nis))


@pytest.mark.parametrize("turn", [0.0, 0.5, -0.5])
def test_latency_is_compensated_on_a_straight_line_and_an_arc(turn):
    estimator, pose = make(UKF, **MATCHED), Pose2D(1.0, 2.0, 3.0)
    twist = Twist2D(0.8, 0.0, turn)
    for _ in range(1000):  # 40 s without noise: nothing of the start is left
        pose = pose.integrate(twist, FRAME_S)
        frame(estimator, pose)
    later, ahead = pose.integrate(twist, 0.2), estimator.ahead(0.2)
    # a heading uncertain by 0.04 rad shortens the way by 0.04²/2, which the filter makes up for
    tolerance = 0.8 * 0.04**2
    assert ahead.pose == pytest.approx(later, abs=0.2 * tolerance)
    assert ahead.velocity[:2] == pytest.approx(rotate(0.8, 0.0, later.yaw), abs=tolerance)
