"""The estimators: common properties, consistency, and their models against independent values."""

import math

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator
from hypothesis import given
from hypothesis import strategies as st
from mecazen.geometry import Pose2D, Twist2D, rotate, wrap
from mecazen_follower.estimators import ESTIMATORS, make_estimator
from mecazen_follower.estimators.imm import (
    IDENTITY,
    MODES,
    OBSERVED,
    SIZE,
    TURNING,
    YAW,
    H,
    ImmBank,
    V,
    ctrv,
    process_noise,
)

DT = 0.01
FRAME_S = 0.04
NOISE = np.diag([0.05**2, 0.05**2, math.radians(5.0) ** 2])


def make(name, **params):
    return make_estimator(name, params)


def walk(estimator, seconds, velocity, start=Pose2D()):  # noqa: B008  # immutable
    """Walk with `velocity`, in odom, and an observation each 40 ms."""
    for tick in range(round(seconds / DT)):
        estimator.predict(DT)
        t = tick * DT
        pose = Pose2D(
            start.x + velocity.x * t, start.y + velocity.y * t, wrap(start.yaw + velocity.yaw * t)
        )
        if tick % 4 == 0:
            estimator.update(pose, NOISE)


@pytest.fixture(params=sorted(ESTIMATORS))
def estimator(request):
    return make(request.param)


def test_the_first_observation_is_the_estimate(estimator):
    estimator.predict(DT)
    assert (estimator.estimate, estimator.ahead(0.2), estimator.nis) == (None, None, None)
    estimator.update(Pose2D(1.0, -2.0, 3.0), NOISE)
    assert estimator.estimate.pose == pytest.approx((1.0, -2.0, 3.0))
    assert estimator.estimate.velocity == Twist2D()
    assert np.asarray(estimator.estimate.covariance) == pytest.approx(NOISE)


def test_a_yaw_across_the_wrap_is_no_jump(estimator):
    # Walking towards -x, the direction of motion too is near ±pi.
    for tick in range(200):
        estimator.predict(DT)
        side = math.pi - 0.02 if tick % 2 else -math.pi + 0.02
        estimator.update(Pose2D(-0.5 * tick * DT, 0.0, side), NOISE)
        assert abs(wrap(estimator.estimate.pose.yaw - math.pi)) < 0.03
        assert -math.pi < estimator.estimate.pose.yaw <= math.pi


def test_a_sensor_without_noise_is_accepted(estimator):
    perfect = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1e-9]]
    for _ in range(3):
        estimator.update(Pose2D(1.0, 2.0, 0.5), perfect)
        estimator.predict(DT)
    assert estimator.estimate.pose == pytest.approx((1.0, 2.0, 0.5), abs=1e-6)


coordinate = st.floats(-1e6, 1e6)
observations = st.tuples(coordinate, coordinate, st.floats(-100.0, 100.0), st.floats(0.001, 5.0))


@given(st.sampled_from(sorted(ESTIMATORS)), st.lists(observations, max_size=20))
def test_the_estimate_is_finite_for_any_observations(name, observed):
    estimator = make(name)
    for x, y, yaw, dt in observed:
        estimator.predict(dt)
        estimator.update(Pose2D(x, y, yaw), NOISE)
        pose, velocity, covariance = estimator.estimate
        assert np.isfinite([*pose, *velocity]).all()
        assert (np.diag(covariance) > 0.0).all()


def test_looking_ahead_changes_nothing_and_a_reset_all(estimator):
    walk(estimator, 2.0, Twist2D(1.0, 0.5, 0.2))
    first, ahead = estimator.estimate, estimator.ahead(0.0)
    assert ahead.pose == pytest.approx(first.pose)
    assert ahead.velocity == pytest.approx(first.velocity)
    estimator.ahead(0.5)
    assert estimator.estimate == first
    estimator.reset()
    assert (estimator.estimate, estimator.nis) == (None, None)
    walk(estimator, 2.0, Twist2D(1.0, 0.5, 0.2))
    assert estimator.estimate == first  # to the last bit


@pytest.mark.parametrize(
    ("velocity", "yaw", "expected"),
    [
        ((0.2, 0.0), 0.0, 0.0),  # literally, F would move them by yaw times the displacement
        ((0.0, 0.5), 0.0, math.pi / 2.0),  # the direction of motion, whatever is observed
        ((0.0, 0.0), 3.0, 3.0),  # at rest the observed yaw
    ],
)
def test_the_displacement_filter_takes_motion_for_the_yaw(velocity, yaw, expected):
    estimator = make("kf_displacement")
    walk(estimator, 10.0, Twist2D(*velocity), Pose2D(yaw=yaw))
    before = estimator.estimate
    for _ in range(100):
        estimator.predict(DT)
    after = estimator.estimate
    assert before.velocity[:2] == pytest.approx(velocity, rel=0.01)  # e^-10 of the smoothing
    moved = after.pose.x - before.pose.x, after.pose.y - before.pose.y
    assert moved == pytest.approx(before.velocity[:2])
    assert after.pose.yaw == pytest.approx(expected, abs=1e-6)


# P[x, x] = 0.0125: 0.0025 + 0.25 * 0.04 of drift; so S = 0.015, K = 5/6, x = 1/12 and
# NIS = 0.01 / 0.015. The speed is (1 - e^-0.02) * x / 0.04 of the smoothing.
def test_linear_filter_has_the_gain_computed_by_hand():
    estimator = make("kf_displacement", position_drift_m_sqrt_s=0.5, smoothing_s=2.0)
    estimator.update(Pose2D(), NOISE)
    estimator.predict(0.04)
    estimator.update(Pose2D(0.1, 0.0, 0.0), NOISE)
    assert estimator.estimate.pose.x == pytest.approx(1 / 12)
    assert estimator.estimate.velocity.x == pytest.approx((1 - math.exp(-0.02)) / 0.48)
    assert estimator.estimate.covariance[0][0] == pytest.approx(0.0125 / 6)
    assert estimator.nis == pytest.approx(2 / 3)


def test_a_steady_walk_is_predicted_exactly():
    twist = Twist2D(0.8, 0.0, -0.5)
    estimator, pose = make("ekf_ctrv"), Pose2D(1.0, 2.0, 3.0)
    for _ in range(1000):  # 40 s without noise: nothing of the start is left
        pose = pose.integrate(twist, FRAME_S)
        estimator.predict(FRAME_S)
        estimator.update(pose, NOISE)
    later, ahead = pose.integrate(twist, 0.2), estimator.ahead(0.2)
    assert ahead.pose == pytest.approx(later, abs=1e-9)
    assert ahead.velocity[:2] == pytest.approx(rotate(0.8, 0.0, later.yaw), abs=1e-9)


SWAY = 0.03
START = np.array([1.0, -2.0, 0.4, 0.0, 0.0])
COVARIANCE = np.diag([*np.diag(NOISE), 1.0, 0.25])
STAND, STROLL, TURN = (0.0, 0.0), (0.8, 0.0), (0.8, 0.7)
WAVERING = 0.1
"""Random walk of the heading of a person who walks on [rad], after 1 s; who stands has a tenth."""

coordinates = st.floats(-10.0, 10.0)
rates = st.one_of(st.just(0.0), st.floats(-1e-6, 1e-6), st.floats(-5.0, 5.0))
states = st.tuples(coordinates, coordinates, coordinates, st.floats(-3.0, 3.0), rates).map(np.array)
times = st.floats(1e-3, 1.0)
variances = st.tuples(*[st.floats(0.0, 9.0)] * SIZE)


@given(states, times, st.floats(0.0, 5.0))
def test_motion_is_the_exponential_map(state, dt, fading):
    x, y, yaw, v, w = state.tolist()
    pose = Pose2D(x, y, yaw).integrate(Twist2D(v, 0.0, w), dt)
    moved, _ = ctrv(state, dt)
    assert moved[:2] == pytest.approx(pose[:2], abs=1e-12)
    assert wrap(moved[YAW] - pose.yaw) == pytest.approx(0.0, abs=1e-12)
    assert moved[V:].tolist() == [v, w]
    h = 1e-5
    steps = [
        ctrv(state + step, dt, fading)[0] - ctrv(state - step, dt, fading)[0]
        for step in h * IDENTITY
    ]
    # h² times third derivatives below 10, and 1e-14 of rounding over h
    assert ctrv(state, dt, fading)[1] == pytest.approx(np.transpose(steps) / (2.0 * h), abs=3e-9)


@given(variances, st.floats(-math.pi, math.pi), times)
def test_process_noise_at_rest_integrates_white_noise(variances, yaw, dt):
    # at v = w = 0 the model is linear
    state = np.array([0.0, 0.0, yaw, 0.0, 0.0])
    _, *densities = variances
    rates = np.diag([densities[0], *densities])
    start, middle, end = (F @ rates @ F.T for F in (ctrv(state, t)[1] for t in (0.0, dt / 2, dt)))
    integral = (start + 4.0 * middle + end) * dt / 6.0  # Simpson: exact for squares of t
    assert process_noise(variances, state, dt) == pytest.approx(integral, rel=1e-12, abs=1e-12)


class FilterpyMode(ExtendedKalmanFilter):
    """A mode as filterpy's extended Kalman filter, with the interface of its Kalman filter."""

    def __init__(self, mode):
        super().__init__(SIZE, OBSERVED)
        self.x, self.P, self._mode = START.copy(), COVARIANCE.copy(), mode
        self._persists = np.array([1.0, 1.0, 1.0, mode.moves, mode.turns])

    def predict_x(self, u=None):
        x = self.x * self._persists
        self.x, F = ctrv(x, FRAME_S, self._mode.fading_1_s)
        self.F = F * self._persists
        self.Q = process_noise(np.square((SWAY, *self._mode[:4])), x, FRAME_S)

    def update(self, z):
        super().update(z, lambda _: H, lambda x: x[:OBSERVED], R=NOISE)


def observed(*phases):
    """Yield noisy observations of a person who walks with (speed, turn rate) for each phase [s]."""
    rng = np.random.default_rng(1)
    state = START.copy()
    for seconds, *motion in phases:
        state[OBSERVED:] = motion
        for _ in range(round(seconds / FRAME_S)):
            state, _ = ctrv(state, FRAME_S)
            if motion[1] == 0.0:
                wavering = WAVERING if motion[0] else WAVERING / 10.0
                state[YAW] += wavering * math.sqrt(FRAME_S) * rng.normal()
            yield state[:OBSERVED] + rng.normal(size=3) * np.sqrt(np.diag(NOISE))


@pytest.mark.parametrize("modes", [(TURNING,), MODES])
def test_the_bank_agrees_with_filterpy(modes):
    bank, n = ImmBank(modes, SWAY, START, COVARIANCE), len(modes)
    transitions = np.array([[FRAME_S / mode.sojourn_s / max(n - 1, 1)] * n for mode in modes])
    np.fill_diagonal(transitions, [1.0 - FRAME_S / mode.sojourn_s * (n > 1) for mode in modes])
    filters = [FilterpyMode(mode) for mode in modes]
    reference = IMMEstimator(filters, [1.0 / n] * n, transitions) if n > 1 else filters[0]
    for z in observed((2.0, *STAND), (2.0, *STROLL), (2.0, *TURN)):
        bank.predict(FRAME_S)
        reference.predict()
        bank.update(z, NOISE)
        reference.update(z)
        x, P = bank.ahead(0.0)
        assert x == pytest.approx(reference.x, abs=1e-9)
        assert pytest.approx(reference.P, abs=1e-9) == P
        if n > 1:
            assert bank.mu == pytest.approx(reference.mu, abs=1e-9)
        else:
            assert bank.nis == pytest.approx(reference.y @ reference.SI @ reference.y, abs=1e-9)
