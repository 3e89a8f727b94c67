"""The bank of modes against filterpy's filters, over long runs, and whether modes are told."""

import math

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator
from follower.walks import FRAME_S as DT
from follower.walks import NOISE
from mecazen_follower.estimators.modes import Mode, ModeBank, correct
from mecazen_follower.estimators.turn_rate import (
    SEEN,
    SIZE,
    YAW,
    jacobian,
    matrix,
    move,
    process_noise,
    propagate,
    triangle,
)

START = np.array([1.0, -2.0, 0.4, 0.0, 0.0])
COVARIANCE = np.diag([*np.diag(NOISE), 1.0, 0.25])
STANDING = Mode((0.03, 0.001, 0.2, 0.02, 0.02), moves=False, turns=False, mean_sojourn=2.0)
STRAIGHT = Mode((0.03, 0.001, 0.01, 0.02, 0.02), turns=False, mean_sojourn=10.0)
TURNING = Mode((0.03, 0.001, 0.0, 0.02, 0.02), mean_sojourn=10.0)
MANOEUVRE = Mode((0.03, 0.05, 0.0, 2.0, 3.0), mean_sojourn=0.5)
MODES = STANDING, STRAIGHT, TURNING, MANOEUVRE
STAND, STROLL, TURN = (0.0, 0.0), (0.8, 0.0), (0.8, 0.7)
LOOKING_AROUND = 0.2
"""Random walk of the heading of who stands [rad], after 1 s."""


class OneMode(ExtendedKalmanFilter):
    """A mode as filterpy's extended Kalman filter, with the interface of its Kalman filter."""

    def __init__(self, mode):
        super().__init__(SIZE, SEEN)
        self.x, self.P = START.copy(), COVARIANCE.copy()
        self._walks = np.array(mode.walks)
        self._keeps = np.array([1.0, 1.0, 1.0, mode.moves, mode.turns])
        self._seen = np.eye(SEEN, SIZE)

    def predict_x(self, u=None):
        x = self.x * self._keeps
        self.F = jacobian(x, DT) * self._keeps
        self.Q = process_noise(self._walks, x, DT)
        self.x = move(x, DT)

    def update(self, z):
        super().update(z, lambda _: self._seen, lambda x: x[:SEEN], R=NOISE)


def observations(*phases, seed=1):
    """Yield noisy observations of who walks with (speed, turn rate) for each of the phases [s]."""
    rng = np.random.default_rng(seed)
    state = START.copy()
    for seconds, *motion in phases:
        state[SEEN:] = motion
        for _ in range(round(seconds / DT)):
            state = move(state, DT)
            if tuple(motion) == STAND:
                state[YAW] += LOOKING_AROUND * math.sqrt(DT) * rng.normal()
            yield state[:SEEN] + rng.normal(size=SEEN) * np.sqrt(np.diag(NOISE))


def transitions(modes):
    """Return the probabilities to go from one mode to another within a frame."""
    n = len(modes)
    M = np.array([[DT / mode.mean_sojourn / (n - 1)] * n for mode in modes])
    np.fill_diagonal(M, [1.0 - DT / mode.mean_sojourn for mode in modes])
    return M


@pytest.mark.parametrize("mode", MODES)
def test_one_mode_is_the_extended_kalman_filter(mode):
    bank, reference = ModeBank((mode,), START, COVARIANCE), OneMode(mode)
    for seen in observations((4.0, *STAND), (4.0, *STROLL), (4.0, *TURN)):
        bank.predict(DT)
        reference.predict()
        assert bank.state == pytest.approx(reference.x, abs=1e-9)
        assert bank.covariance == pytest.approx(reference.P, abs=1e-9)
        bank.update(seen, NOISE)
        reference.update(seen)
        assert bank.state == pytest.approx(reference.x, abs=1e-9)
        assert bank.covariance == pytest.approx(reference.P, abs=1e-9)
        assert bank.nis == pytest.approx(reference.y @ reference.SI @ reference.y, abs=1e-9)
        assert bank.probabilities == [1.0]


def test_an_observation_whose_noise_is_no_covariance_changes_nothing():
    bank = ModeBank(MODES, START, COVARIANCE)
    with pytest.raises(ValueError, match="positive definite"):
        bank.update(START[:SEEN], -10.0 * NOISE)
    assert (bank.state == START).all()
    assert bank.covariance == pytest.approx(COVARIANCE)


@pytest.mark.parametrize("modes", [MODES, (STRAIGHT, MANOEUVRE)])
def test_several_modes_are_the_interacting_multiple_models(modes):
    bank = ModeBank(modes, START, COVARIANCE)
    n = len(modes)
    reference = IMMEstimator([OneMode(mode) for mode in modes], [1.0 / n] * n, transitions(modes))
    for seen in observations((4.0, *STAND), (4.0, *STROLL), (4.0, *TURN)):
        bank.predict(DT)
        reference.predict()
        assert bank.probabilities == pytest.approx(reference.cbar, abs=1e-9)
        bank.update(seen, NOISE)
        reference.update(seen)
        assert bank.probabilities == pytest.approx(reference.mu, abs=1e-9)
        assert bank.state == pytest.approx(reference.x, abs=1e-9)
        assert bank.covariance == pytest.approx(reference.P, abs=1e-9)


def test_over_10_000_frames_with_dropouts_it_stays_a_probability_and_a_covariance():
    rng = np.random.default_rng(2)
    bank = ModeBank(MODES, START, COVARIANCE)
    seen_for = ((20.0, *motion) for _ in range(7) for motion in (STAND, STROLL, TURN))
    sums, covariances = [], []
    dropout = 0
    for frame, seen in enumerate(observations(*seen_for, seed=3)):
        bank.predict(DT)
        if frame % 250 == 0:
            dropout = int(rng.integers(0, 100))
        dropout -= 1
        if dropout < 0:
            bank.update(seen, NOISE)
        sums.append(sum(bank.probabilities))
        covariances.append(bank.covariance)
    assert len(sums) > 10_000
    P = np.array(covariances)
    assert np.array(sums) == pytest.approx(np.ones(len(sums)), abs=1e-12)
    assert np.abs(P - P.swapaxes(1, 2)).max() < 1e-12  # rounding of 4 products below 1
    assert np.linalg.eigvalsh(P).min() > 0.0


def likeliest(seens):
    """Return the mode that is likeliest on average over the last 5 s."""
    bank, probabilities = ModeBank(MODES, START, COVARIANCE), []
    for seen in seens:
        bank.predict(DT)
        bank.update(seen, NOISE)
        probabilities.append(bank.probabilities)
    return MODES[np.mean(probabilities[-125:], axis=0).argmax()]


@pytest.mark.parametrize(
    ("motion", "mode"), [(STAND, STANDING), (STROLL, STRAIGHT), (TURN, TURNING)]
)
@pytest.mark.parametrize("before", [STAND, STROLL, TURN])
def test_after_15_s_it_knows_how_the_person_moves_whatever_they_did_before(motion, mode, before):
    assert likeliest(observations((5.0, *before), (15.0, *motion))) is mode


def test_who_turns_back_and_forth_each_half_second_manoeuvres():
    zigzag = [(0.5, 1.0, turn) for _ in range(10) for turn in (3.0, -3.0)]
    assert likeliest(observations(*zigzag)) is MANOEUVRE


@pytest.mark.parametrize("far", [1e2, 1e6])
def test_hopeless_observations_in_a_row_break_nothing(far):
    bank = ModeBank(MODES, START, COVARIANCE)
    for seen in ([far, 0.0, 0.0], [0.0, far, 0.0], [-far, 0.0, 0.0], [0.0, 0.0, 0.0]):
        bank.update(np.array(seen), NOISE)
        bank.update(-np.array(seen), NOISE)
        assert sum(bank.probabilities) == pytest.approx(1.0)
        bank.predict(1.0)
        bank.update(np.array(seen), NOISE)
        assert np.linalg.eigvalsh(bank.covariance)[0] > 0.0


def test_a_correction_is_a_covariance_and_what_josephs_form_gives():
    rng = np.random.default_rng(4)
    for _ in range(300):
        state, P = (
            (0.0, 0.0, rng.normal(), *rng.normal(size=2)),
            np.diag(10.0 ** rng.uniform(-6, 0, 5)),
        )
        P = triangle(P)
        for _ in range(20):  # from well known to lost
            state, P = propagate(state, P, tuple(10.0 ** rng.uniform(-3, 0.5, 5)), 0.1)
        root = rng.normal(size=(SEEN, SEEN)) * 10.0 ** rng.uniform(-5, 0)
        R = root @ root.T + 1e-12 * np.eye(SEEN)
        corrected = matrix(correct(state, P, state[:SEEN], R.tolist()).after.covariance)
        P, H = matrix(P), np.eye(SEEN, SIZE)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        keeps = np.eye(SIZE) - K @ H
        deviations = np.sqrt(np.diag(corrected))
        scale = np.outer(deviations, deviations)
        assert np.linalg.eigvalsh(corrected / scale)[0] > 0.0
        joseph = keeps @ P @ keeps.T + K @ R @ K.T
        # what is left is down to 1e-6 of what was, of which 1e-16 is rounding
        assert corrected / scale == pytest.approx(joseph / scale, abs=1e-8)


def test_over_a_step_longer_than_modes_last_probabilities_stay_such():
    brief = [mode._replace(mean_sojourn=0.01) for mode in MODES]
    bank = ModeBank(tuple(brief), START, COVARIANCE)
    for seen in observations((4.0, *STROLL)):
        bank.predict(DT)
        assert min(bank.probabilities) > 0.0
        assert sum(bank.probabilities) == pytest.approx(1.0)
        bank.update(seen, NOISE)
        assert np.linalg.eigvalsh(bank.covariance)[0] > 0.0


def test_ahead_is_what_a_single_mode_predicts():
    bank = ModeBank((TURNING,), START, COVARIANCE)
    for seen in observations((4.0, *TURN)):
        bank.predict(DT)
        bank.update(seen, NOISE)
    state, covariance = bank.ahead(DT)
    bank.predict(DT)
    assert state == pytest.approx(bank.state, abs=1e-12)
    assert matrix(covariance) == pytest.approx(bank.covariance, abs=1e-12)
