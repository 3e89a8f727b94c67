"""Each estimator against numbers by hand, at the wrap, and against its own statistics."""

import math
from functools import partial

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from mecazen.geometry import Pose2D, Twist2D, rotate, wrap
from mecazen_follower.estimators import ESTIMATORS, Estimate, make_params
from mecazen_follower.estimators.ctrv import MIN_POSITION_WALK
from mecazen_follower.estimators.turn_rate import move, process_noise
from scipy.stats import chi2

DT = 0.01
ORIGIN = Pose2D()
NOISE = np.diag([0.05**2, 0.05**2, math.radians(5.0) ** 2])


def make(name, **params):
    return ESTIMATORS[name](make_params(name, params))


@pytest.fixture(params=sorted(ESTIMATORS))
def estimator(request):
    return make(request.param)


def walk(estimator, seconds, velocity, start=ORIGIN):
    """Walk with `velocity`, in odom, and an observation each 40 ms; return the last pose."""
    pose = start
    for tick in range(round(seconds / DT)):
        estimator.predict(DT)
        t = tick * DT
        pose = Pose2D(
            start.x + velocity.x * t,
            start.y + velocity.y * t,
            wrap(start.yaw + velocity.yaw * t),
        )
        if tick % 4 == 0:
            estimator.update(pose, NOISE)
    return pose


def test_registry_holds_the_names():
    names = {"none", "kf_displacement", "kf_cv", "ekf_ctrv", "ukf_ctrv", "imm"}
    assert set(ESTIMATORS) == names


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


FAR = Pose2D(9.0, 9.0, 0.0)


@pytest.mark.parametrize(
    ("pose", "covariance", "message"),
    [
        *((Pose2D(bad), NOISE, "out of range") for bad in (math.nan, math.inf, 1e300)),
        *(
            (FAR, covariance, "covariance")
            for covariance in (
                np.eye(2),
                np.full((3, 3), math.nan),
                np.diag([math.inf, 1.0, 1.0]),
                -np.eye(3),
                [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
                [[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            )
        ),
    ],
)
def test_an_invalid_observation_is_refused_and_changes_nothing(
    estimator, pose, covariance, message
):
    walk(estimator, 0.2, Twist2D(1.0, 0.0, 0.0))
    before = estimator.estimate
    with pytest.raises(ValueError, match=message):
        estimator.update(pose, covariance)
    assert estimator.estimate == before


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


def test_unknown_names_and_parameters_are_refused_with_those_allowed():
    with pytest.raises(ValueError, match=r"'ekf', allowed: ekf_ctrv, imm, kf_cv, kf_d"):
        make_params("ekf", {})
    with pytest.raises(ValueError, match=r"no parameter smoothing_s, allowed: .*acceleration"):
        make_params("kf_cv", {"smoothing_s": 1.0})
    with pytest.raises(ValueError, match="acceleration_std_m_s2"):
        make_params("kf_cv", {"acceleration_std_m_s2": -1.0})


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


@pytest.mark.parametrize("name", ["imm", "ekf_ctrv", "ukf_ctrv"])
def test_a_reset_forgets_the_learnt_noise(name):
    fresh, used = make(name, noise_memory_s=1.0), make(name, noise_memory_s=1.0)
    for tick in range(50):
        used.predict(DT)
        used.update(Pose2D((-1.0) ** tick, 0.0, 0.0), NOISE)
    used.reset()
    for estimator in (fresh, used):
        walk(estimator, 1.0, Twist2D(1.0, 0.5, 0.2))
    assert used.estimate == fresh.estimate


# none


def test_none_holds_the_last_observation():
    estimator = make("none")
    estimator.update(Pose2D(1.0, 2.0, 3.0), NOISE)
    for _ in range(100):
        estimator.predict(DT)
    assert estimator.estimate.pose == (1.0, 2.0, 3.0)


# kf_displacement


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


def test_displacement_filter_corrects_by_the_gain_computed_by_hand():
    estimator = make("kf_displacement", position_drift_m_sqrt_s=0.5, smoothing_s=2.0)
    estimator.update(Pose2D(), NOISE)
    estimator.predict(0.04)
    estimator.update(Pose2D(0.1, 0.0, 0.0), NOISE)
    # P = 0.0025 + 0.25 * 0.04 = 0.0125, K = 0.0125 / 0.015 = 5/6, x = 1/12,
    # NIS = 0.01 / 0.015; Δ per second = (1 - e^-0.02) * x / 0.04.
    pose, velocity, covariance = estimator.estimate
    assert pose.x == pytest.approx(1 / 12)
    assert covariance[0][0] == pytest.approx(0.0125 / 6)
    assert estimator.nis == pytest.approx(2 / 3)
    assert velocity.x == pytest.approx((1 - math.exp(-0.02)) / 0.48)


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


# kf_cv


def test_constant_velocity_filter_corrects_by_the_gain_computed_by_hand():
    estimator = make("kf_cv", acceleration_std_m_s2=1e-6, initial_speed_std_m_s=1.0)
    estimator.update(Pose2D(), NOISE)
    estimator.predict(0.1)
    estimator.update(Pose2D(0.1, 0.0, 0.0), NOISE)
    # P = [[0.0025 + 0.01, 0.1], [0.1, 1]], S = 0.015, K = [5/6, 20/3].
    assert estimator.estimate.pose.x == pytest.approx(1 / 12)
    assert estimator.estimate.velocity.x == pytest.approx(2 / 3)
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


# constant turn rate and velocity

MATCHED = {
    "sway_m_sqrt_m": 0.05,
    "acceleration_std_m_s2": 0.3,
    "yaw_acceleration_std_rad_s2": 0.3,
    "initial_speed_std_m_s": 0.5,
    "initial_yaw_rate_std_rad_s": 0.3,
}
FRAME_S = 0.04
CTRV = pytest.mark.parametrize("name", ["ekf_ctrv", "ukf_ctrv"])


def frame(estimator, pose, noise=NOISE):
    """Let a frame pass in which the estimator sees a person, at the heading `pose[2]` [rad]."""
    estimator.predict(FRAME_S)
    estimator.update(Pose2D(float(pose[0]), float(pose[1]), wrap(float(pose[2]))), noise)


@pytest.mark.parametrize(
    # The unscented filter knows that a heading uncertain by 0.04 rad shortens the way by
    # 0.04²/2, and so finds who does not sway faster than they are.
    ("name", "tolerance"),
    [("ekf_ctrv", 1e-9), ("ukf_ctrv", 0.8 * 0.04**2)],
)
@pytest.mark.parametrize("turn", [0.0, 0.5, -0.5])
def test_latency_is_made_up_for_exactly_on_a_straight_line_and_an_arc(name, tolerance, turn):
    estimator, pose = make(name, **MATCHED), Pose2D(1.0, 2.0, 3.0)
    twist = Twist2D(0.8, 0.0, turn)
    for _ in range(1000):  # 40 s without noise: nothing of the start is left
        pose = pose.integrate(twist, FRAME_S)
        frame(estimator, pose)
    later, ahead = pose.integrate(twist, 0.2), estimator.ahead(0.2)
    assert ahead.pose == pytest.approx(later, abs=0.2 * tolerance)
    assert ahead.velocity[:2] == pytest.approx(rotate(0.8, 0.0, later.yaw), abs=tolerance)
    assert np.trace(ahead.covariance) > np.trace(estimator.estimate.covariance)


@CTRV
def test_many_short_predictions_are_one_long_one(name):
    whole, divided = make(name, **MATCHED), make(name, **MATCHED)
    for estimator in (whole, divided):
        walk(estimator, 2.0, Twist2D(0.5, 0.0, 0.0))
    whole.predict(0.08)
    for _ in range(8):
        divided.predict(DT)
    assert divided.estimate.pose == pytest.approx(whole.estimate.pose, abs=1e-12)


def simulate_turning(name, seconds, rng):
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
        *(
            pytest.param(partial(simulate_turning, name), id=name)
            for name in ("ekf_ctrv", "ukf_ctrv")
        ),
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


def test_unscented_and_extended_agree_where_the_noise_is_small():
    rng = np.random.default_rng(1)
    filters = [make(name, **MATCHED) for name in ("ekf_ctrv", "ukf_ctrv")]
    state = np.array([0.0, 0.0, 0.0, 0.8, 0.5])
    for _ in range(250):
        state = move(state, FRAME_S)
        seen = state[:3] + 0.001 * rng.normal(size=3)
        for estimator in filters:
            frame(estimator, seen, np.eye(3) * 0.001**2)
        extended, unscented = (estimator.estimate for estimator in filters)
        apart = np.array(unscented.pose) - np.array(extended.pose)
        apart[2] = wrap(apart[2])
        # What they differ in is of second order: v times the heading's variance of 1e-6.
        assert (np.abs(apart) < 1e-5 * np.sqrt(np.diag(extended.covariance))).all()


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
