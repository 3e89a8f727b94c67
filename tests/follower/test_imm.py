"""The IMM filter: its model against calculus, its bank against filterpy, and its modes."""

import math

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator
from follower.walks import DT, FRAME_S, MATCHED, NOISE, frame, make, walk
from hypothesis import given
from hypothesis import strategies as st
from mecazen.geometry import Pose2D, Twist2D, rotate, wrap
from mecazen_follower.estimators.imm import (
    BLUNT,
    IDENTITY,
    MANOEUVRING,
    OBSERVED,
    SHARP,
    SIZE,
    STANDING,
    STRAIGHT,
    TURNING,
    YAW,
    H,
    ImmBank,
    V,
    ctrv,
    modes_at,
    process_noise,
)

SWAY = 0.03
START = np.array([1.0, -2.0, 0.4, 0.0, 0.0])
COVARIANCE = np.diag([*np.diag(NOISE), 1.0, 0.25])
STAND, STROLL, TURN = (0.0, 0.0), (0.8, 0.0), (0.8, 0.7)
WAVERING = 0.1
"""Random walk of the heading of a person who does not turn [rad], after 1 s."""

coordinates = st.floats(-10.0, 10.0)
rates = st.one_of(st.just(0.0), st.floats(-1e-6, 1e-6), st.floats(-5.0, 5.0))
states = st.tuples(coordinates, coordinates, coordinates, st.floats(-3.0, 3.0), rates).map(np.array)
times = st.floats(1e-3, 1.0)
variances = st.tuples(*[st.floats(0.0, 9.0)] * SIZE)


@given(states, times)
def test_the_motion_is_the_exponential_map_of_a_pose(state, dt):
    x, y, yaw, v, w = state.tolist()
    pose = Pose2D(x, y, yaw).integrate(Twist2D(v, 0.0, w), dt)
    moved, _ = ctrv(state, dt)
    assert moved[:2] == pytest.approx(pose[:2], abs=1e-12)
    assert wrap(moved[YAW] - pose.yaw) == pytest.approx(0.0, abs=1e-12)
    assert moved[V:].tolist() == [v, w]


@given(states, times, st.floats(0.0, 5.0))
def test_the_jacobian_agrees_with_central_differences(state, dt, fading):
    h = 1e-5
    steps = [
        ctrv(state + step, dt, fading)[0] - ctrv(state - step, dt, fading)[0]
        for step in h * IDENTITY
    ]
    # h² times third derivatives below 10, and 1e-14 of rounding over h
    assert ctrv(state, dt, fading)[1] == pytest.approx(np.transpose(steps) / (2.0 * h), abs=3e-9)


@given(variances, states, times)
def test_process_noise_is_a_covariance(variances, state, dt):
    Q = process_noise(variances, state, dt)
    assert (Q == Q.T).all()
    assert np.linalg.eigvalsh(Q)[0] >= -1e-14 * np.trace(Q)


@given(variances, st.floats(-math.pi, math.pi), times)
def test_process_noise_at_rest_is_the_integral_of_white_noise(variances, yaw, dt):
    # at v = w = 0 the model is linear
    state = np.array([0.0, 0.0, yaw, 0.0, 0.0])
    _, *white = variances
    rates = np.diag([white[0], *white])
    start, middle, end = (F @ rates @ F.T for F in (ctrv(state, t)[1] for t in (0.0, dt / 2, dt)))
    integral = (start + 4.0 * middle + end) * dt / 6.0  # Simpson: exact for squares of t
    assert process_noise(variances, state, dt) == pytest.approx(integral, rel=1e-12, abs=1e-12)


def test_sway_grows_with_the_distance_walked():
    state = np.array([0.0, 0.0, 1.0, -2.0, 0.0])
    Q = process_noise((0.0009, 0.0, 0.0, 0.0, 0.0), state, 0.5)
    assert pytest.approx(np.diag([0.0009, 0.0009, 0.0, 0.0, 0.0])) == Q  # 1 m walked


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


def observations(*phases, seed=1):
    """Yield noisy observations of a person who walks with (speed, turn rate) for each phase [s]."""
    rng = np.random.default_rng(seed)
    state = START.copy()
    for seconds, *motion in phases:
        state[OBSERVED:] = motion
        for _ in range(round(seconds / FRAME_S)):
            state, _ = ctrv(state, FRAME_S)
            if motion[1] == 0.0:
                state[YAW] += WAVERING * math.sqrt(FRAME_S) * rng.normal()
            yield state[:OBSERVED] + rng.normal(size=OBSERVED) * np.sqrt(np.diag(NOISE))


@pytest.mark.parametrize("modes", [(TURNING,), (STRAIGHT, MANOEUVRING), SHARP])
def test_the_bank_agrees_with_filterpy(modes):
    bank, n = ImmBank(modes, SWAY, START, COVARIANCE), len(modes)
    transitions = np.array([[FRAME_S / mode.sojourn_s / max(n - 1, 1)] * n for mode in modes])
    np.fill_diagonal(transitions, [1.0 - FRAME_S / mode.sojourn_s * (n > 1) for mode in modes])
    filters = [FilterpyMode(mode) for mode in modes]
    reference = IMMEstimator(filters, [1.0 / n] * n, transitions) if n > 1 else filters[0]
    for z in observations((4.0, *STAND), (4.0, *STROLL), (4.0, *TURN)):
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


def test_covariances_stay_positive_through_dropouts_outliers_and_long_steps():
    rng = np.random.default_rng(2)
    bank = ImmBank(SHARP, SWAY, START, COVARIANCE)
    phases = ((20.0, *motion) for motion in (STAND, STROLL, TURN))
    for k, z in enumerate(observations(*phases, seed=3)):
        bank.predict(10.0 if k % 500 == 499 else FRAME_S)  # longer than all modes last
        if rng.random() < 0.5:
            outlier = 1e6 if k % 100 > 97 else 0.0
            bank.update(z + outlier * rng.normal(size=OBSERVED), 1e-6 * NOISE if k % 7 else NOISE)
        assert bank.mu.min() > 0.0
        assert bank.mu.sum() == pytest.approx(1.0, abs=1e-12)
        _, P = bank.ahead(0.1)
        scale = np.sqrt(np.diag(P))
        # rounding is 1e-16 of P before an update that shrinks it up to 1e9 times
        assert np.linalg.eigvalsh(P / np.outer(scale, scale))[0] > -1e-7


@pytest.mark.parametrize(
    ("phases", "mode"),
    [
        ([(5.0, *TURN), (15.0, *STAND)], STANDING),
        ([(5.0, *STAND), (15.0, *STROLL)], STRAIGHT),
        ([(5.0, *STROLL), (15.0, *TURN)], TURNING),
        ([(0.5, 1.0, turn) for _ in range(10) for turn in (3.0, -3.0)], MANOEUVRING),
    ],
)
def test_the_likeliest_mode_is_how_the_person_moves(phases, mode):
    bank, probabilities = ImmBank(SHARP, SWAY, START, COVARIANCE), []
    for z in observations(*phases):
        bank.predict(FRAME_S)
        bank.update(z, NOISE)
        probabilities.append(bank.mu)
    assert SHARP[np.mean(probabilities[-125:], axis=0).argmax()] is mode  # over the last 5 s


def test_modes_change_by_a_power_of_the_noise_between_sharp_and_blunt():
    def rows(modes):
        return np.array(modes, float)

    assert rows(modes_at(1.0)) == pytest.approx(rows(SHARP))
    assert rows(modes_at(180.0)) == pytest.approx(rows(BLUNT))
    middle = rows(modes_at(math.sqrt(5.0 * 65.0)))
    assert middle == pytest.approx(np.sqrt(rows(SHARP) * rows(BLUNT)))


@pytest.mark.parametrize("turn", [0.0, -0.5])
def test_latency_is_compensated_exactly_on_a_line_and_an_arc(turn):
    estimator, pose = make("ekf_ctrv", **MATCHED), Pose2D(1.0, 2.0, 3.0)
    twist = Twist2D(0.8, 0.0, turn)
    for _ in range(1000):  # 40 s without noise: nothing of the start is left
        pose = pose.integrate(twist, FRAME_S)
        frame(estimator, pose)
    later, ahead = pose.integrate(twist, 0.2), estimator.ahead(0.2)
    assert ahead.pose == pytest.approx(later, abs=1e-9)
    assert ahead.velocity[:2] == pytest.approx(rotate(0.8, 0.0, later.yaw), abs=1e-9)
    assert np.trace(ahead.covariance) > np.trace(estimator.estimate.covariance)


def test_many_short_predictions_equal_one_long_one():
    whole, divided = make("imm"), make("imm")
    for estimator in (whole, divided):
        walk(estimator, 2.0, Twist2D(0.5, 0.0, 0.0))
    whole.predict(0.08)
    for _ in range(8):
        divided.predict(DT)
    assert divided.estimate.pose == pytest.approx(whole.estimate.pose, abs=1e-12)
