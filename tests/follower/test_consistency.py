"""Each filter against its own statistics: NEES, NIS, and how well it knows the heading."""

import math

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from follower.walks import DT, FRAME_S, MATCHED, NOISE, frame, make
from mecazen.geometry import Pose2D, wrap
from mecazen_follower.estimators.ctrv import MIN_POSITION_WALK
from mecazen_follower.estimators.turn_rate import move, process_noise
from scipy.stats import chi2


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


def simulate_turning(seconds, rng, name="ekf_ctrv"):
    """Yield truth, estimate and NIS after each frame; the truth moves as the filter thinks."""
    estimator = make(name, **MATCHED)
    walks = np.array([MATCHED["sway_m_sqrt_m"], MIN_POSITION_WALK, 0.0, 0.3, 0.3])
    state = rng.normal(size=5) * [5.0, 5.0, 2.0, 0.5, 0.3]
    for _ in range(round(seconds / FRAME_S)):
        frame(estimator, state[:3] + rng.normal(size=3) * np.sqrt(np.diag(NOISE)))
        yield state[:3], estimator.estimate, estimator.nis
        root = np.linalg.cholesky(process_noise(walks, state, FRAME_S))
        state = move(state, FRAME_S) + root @ rng.normal(size=5)


MATCHED_MODELS = pytest.mark.parametrize(
    "simulate",
    [
        pytest.param(simulate_constant_velocity, id="kf_cv"),
        pytest.param(simulate_turning, id="ekf_ctrv"),
    ],
)


@MATCHED_MODELS
def test_nees_of_the_matched_model_is_chi_square(simulate):
    # 100 independent runs, 3 degrees of freedom each; two-sided 99.9 %.
    runs, rng, total = 100, np.random.default_rng(7), 0.0
    for _ in range(runs):
        *_, (truth, estimate, _) = simulate(2.0, rng)
        error = truth - np.array(estimate.pose)
        error[2] = wrap(error[2])
        total += error @ np.linalg.solve(np.array(estimate.covariance), error)
    assert chi2.ppf(0.0005, 3 * runs) < total < chi2.ppf(0.9995, 3 * runs)


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
