"""The interacting multiple models: their modes, and the noise that they learn."""

import math

import numpy as np
import pytest
from follower.walks import FRAME_S, NOISE, make
from mecazen.geometry import Pose2D, wrap
from mecazen_follower.estimators.imm import (
    AT_BLUNT,
    AT_SHARP,
    BLUNT_DEG,
    SHARP_DEG,
    at_noise,
    modes_of,
)
from mecazen_follower.estimators.turn_rate import SEEN, move


def test_a_sharp_and_a_blunt_sensor_have_the_parameters_found_for_them():
    assert at_noise(SHARP_DEG) == at_noise(1.0) == pytest.approx(AT_SHARP)
    blunt = at_noise(BLUNT_DEG)
    assert blunt == pytest.approx(AT_SHARP | AT_BLUNT)
    assert blunt == pytest.approx(at_noise(180.0))


def test_between_sharp_and_blunt_a_parameter_changes_by_a_power_of_the_noise():
    middle = at_noise(math.sqrt(SHARP_DEG * BLUNT_DEG))
    expected = math.sqrt(AT_BLUNT["manoeuvre_s"] * AT_SHARP["manoeuvre_s"])
    assert middle["manoeuvre_s"] == pytest.approx(expected)
    assert middle["turning_s"] == AT_SHARP["turning_s"]  # the same at any noise


def test_of_the_five_modes_one_stands_and_two_do_not_turn():
    modes = modes_of(0.012, AT_SHARP)
    assert [mode.moves for mode in modes] == [False, True, True, True, True]
    assert [mode.turns for mode in modes] == [False, False, True, True, True]
    assert modes[-1].mean_sojourn == AT_SHARP["manoeuvre_s"]


def error_and_nees(memory):
    """Return mean position error [m] and NEES with a sensor 3 times worse than reported."""
    rng = np.random.default_rng(5)
    estimator = make("imm", noise_memory_s=memory)
    state = np.array([0.0, 0.0, 0.0, 0.8, 0.0])
    errors, nees = [], []
    for frame in range(1500):  # a minute, in turns of 10 s straight and 10 s of a circle
        state[4] = 0.5 if frame % 500 < 250 else 0.0
        state = move(state, FRAME_S)
        x, y, yaw = (state[:SEEN] + 3.0 * rng.normal(size=3) * np.sqrt(np.diag(NOISE))).tolist()
        estimator.predict(FRAME_S)
        estimator.update(Pose2D(x, y, wrap(yaw)), NOISE)
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
